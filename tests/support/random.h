// Random: SplitMix64 (Steele, Lea, Flood 2014). The same numbers on every machine. Thread-confined.
#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>

#include "storage/base/vec3.h"

namespace raymill::tests {

class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t next() {
    std::uint64_t z = state_ += 0x9E3779B97F4A7C15u;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    z = (z ^ z >> 27) * 0x94D049BB133111EBu;
    return z ^ z >> 31;
  }
  std::uint32_t below(std::uint32_t n) { return static_cast<std::uint32_t>((next() >> 32) * n >> 32); }
  /// In [low, high).
  float uniform(float low, float high) { return low + (high - low) * (float(next() >> 40) * 0x1p-24F); }
  storage::Vec3f in_box(float low, float high) {
    const float x = uniform(low, high), y = uniform(low, high), z = uniform(low, high);
    return {x, y, z};
  }
  /// A direction of about length one.
  storage::Vec3f direction() {
    const float z = uniform(-1, 1), angle = uniform(0, 6.2831853F);
    const float r = std::sqrt(1 - z * z);
    return {r * std::cos(angle), r * std::sin(angle), z};
  }

 private:
  std::uint64_t state_;
};

/// One of them.
template <typename T>
T pick(Random& random, std::initializer_list<T> values) {
  return values.begin()[random.below(static_cast<std::uint32_t>(values.size()))];
}

}  // namespace raymill::tests
