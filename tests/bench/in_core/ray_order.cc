#include "tests/bench/in_core/ray_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace raymill::bench {
namespace {

constexpr unsigned kAxisBits = 8;
constexpr unsigned kDigitBits = 9;
constexpr unsigned kDigits = 3;
static_assert(kDigits * kDigitBits == 3 * kAxisBits + 3);

// abcdefgh -> a00b00c00d00e00f00g00h
std::uint32_t spread(std::uint32_t x) {
  x = (x | x << 8) & 0x00F00F;
  x = (x | x << 4) & 0x0C30C3;
  return (x | x << 2) & 0x249249;
}

struct Keyed {
  std::uint32_t key, index;
};

std::vector<Keyed> keys_of(std::span<const Ray> rays) {
  std::array<float, 3> low, scale;
  for (unsigned axis = 0; axis < 3; ++axis) {
    float least = std::numeric_limits<float>::max(), most = std::numeric_limits<float>::lowest();
    for (const Ray& ray : rays) {
      least = std::min(least, ray.org[axis]);
      most = std::max(most, ray.org[axis]);
    }
    low[axis] = least;
    scale[axis] = most > least ? 255.0F / (most - least) : 0.0F;
  }
  std::vector<Keyed> keys(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    std::uint32_t morton = 0, octant = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
      const float cell = (rays[i].org[axis] - low[axis]) * scale[axis];
      morton |= spread(static_cast<std::uint32_t>(std::clamp(cell, 0.0F, 255.0F))) << axis;
      octant |= static_cast<std::uint32_t>(std::signbit(rays[i].dir[axis])) << axis;
    }
    keys[i] = {morton << 3 | octant, static_cast<std::uint32_t>(i)};
  }
  return keys;
}

}  // namespace

std::vector<std::uint32_t> sorted_order(std::span<const Ray> rays) {
  std::vector<Keyed> keys = keys_of(rays), other(rays.size());
  for (unsigned digit = 0; digit < kDigits; ++digit) {
    std::array<std::uint32_t, 1U << kDigitBits> place{};
    const auto digit_of = [digit](const Keyed& keyed) {
      return keyed.key >> (digit * kDigitBits) & ((1U << kDigitBits) - 1);
    };
    for (const Keyed& keyed : keys) {
      ++place[digit_of(keyed)];
    }
    std::uint32_t begin = 0;
    for (std::uint32_t& count : place) {
      const std::uint32_t size = count;
      count = begin;
      begin += size;
    }
    for (const Keyed& keyed : keys) {
      other[place[digit_of(keyed)]++] = keyed;
    }
    keys.swap(other);
  }
  std::vector<std::uint32_t> order(rays.size());
  std::transform(keys.begin(), keys.end(), order.begin(), [](const Keyed& keyed) { return keyed.index; });
  return order;
}

}  // namespace raymill::bench
