#include "traversal/ray_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "storage/base/quotes.h"

namespace raymill::traversal {
namespace {

constexpr unsigned kAxisBits = 8;
constexpr unsigned kDigitBits = 9;
constexpr unsigned kDigits = 3;
static_assert(kDigits * kDigitBits == 3 * kAxisBits + 3);

// Pairs that are looked at, and the part of the box's side within which the two of a pair are neighbours.
constexpr std::size_t kSampledPairs = 256;
constexpr float kNearPart = 1.0F / 16;

// abcdefgh -> a00b00c00d00e00f00g00h
std::uint32_t spread(std::uint32_t x) {
  x = (x | x << 8) & 0x00F00F;
  x = (x | x << 4) & 0x0C30C3;
  return (x | x << 2) & 0x249249;
}

// The box of the origins of every stride-th ray.
struct Box {
  Box(std::span<const Ray> rays, std::size_t stride) {
    for (std::size_t i = 0; i < rays.size(); i += stride) {
      for (unsigned axis = 0; axis < 3; ++axis) {
        least[axis] = std::min(least[axis], rays[i].org[axis]);
        most[axis] = std::max(most[axis], rays[i].org[axis]);
      }
    }
  }
  std::array<float, 3> least = {std::numeric_limits<float>::max(), std::numeric_limits<float>::max(),
                                std::numeric_limits<float>::max()};
  std::array<float, 3> most = {std::numeric_limits<float>::lowest(), std::numeric_limits<float>::lowest(),
                               std::numeric_limits<float>::lowest()};
};

}  // namespace

Result<SortRays> parse_sort_rays(const std::string& name) {
  if (name == "auto") {
    return SortRays::automatic;
  }
  if (name == "never") {
    return SortRays::never;
  }
  if (name == "always") {
    return SortRays::always;
  }
  return {ErrorCode::invalid_argument, in_quotes(name) + " says nothing of sorting rays; auto, never and always do"};
}

void RayOrder::make_keys(std::span<const Ray> rays) {
  const Box box(rays, 1);
  std::array<float, 3> scale;
  for (unsigned axis = 0; axis < 3; ++axis) {
    scale[axis] = box.most[axis] > box.least[axis] ? 255.0F / (box.most[axis] - box.least[axis]) : 0.0F;
  }
  keys_.resize(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    std::uint32_t morton = 0, octant = 0;
    for (unsigned axis = 0; axis < 3; ++axis) {
      const float cell = (rays[i].org[axis] - box.least[axis]) * scale[axis];
      morton |= spread(cell > 0 ? static_cast<std::uint32_t>(std::min(cell, 255.0F)) : 0) << axis;
      octant |= static_cast<std::uint32_t>(std::signbit(rays[i].dir[axis])) << axis;
    }
    keys_[i] = {morton << 3 | octant, static_cast<std::uint32_t>(i)};
  }
}

std::span<const std::uint32_t> RayOrder::sort(std::span<const Ray> rays) {
  make_keys(rays);
  other_.resize(rays.size());
  for (unsigned digit = 0; digit < kDigits; ++digit) {
    std::array<std::uint32_t, 1U << kDigitBits> place{};
    const auto digit_of = [digit](const Keyed& keyed) {
      return keyed.key >> (digit * kDigitBits) & ((1U << kDigitBits) - 1);
    };
    for (const Keyed& keyed : keys_) {
      ++place[digit_of(keyed)];
    }
    std::uint32_t begin = 0;
    for (std::uint32_t& count : place) {
      const std::uint32_t size = count;
      count = begin;
      begin += size;
    }
    for (const Keyed& keyed : keys_) {
      other_[place[digit_of(keyed)]++] = keyed;
    }
    keys_.swap(other_);
  }
  order_.resize(rays.size());
  std::transform(keys_.begin(), keys_.end(), order_.begin(), [](const Keyed& keyed) { return keyed.index; });
  return order_;
}

bool RayOrder::is_scattered(std::span<const Ray> rays) {
  if (rays.size() < 2 * kSampledPairs) {
    return false;
  }
  const std::size_t stride = rays.size() / kSampledPairs;
  const Box box(rays, stride);
  std::size_t near = 0;
  for (std::size_t pair = 0; pair < kSampledPairs; ++pair) {
    const Ray &a = rays[pair * stride], &b = rays[pair * stride + 1];
    bool is_near = true;
    for (unsigned axis = 0; axis < 3; ++axis) {
      is_near = is_near && std::fabs(a.org[axis] - b.org[axis]) <= (box.most[axis] - box.least[axis]) * kNearPart;
    }
    near += is_near ? 1 : 0;
  }
  return near < kSampledPairs / 2;
}

}  // namespace raymill::traversal
