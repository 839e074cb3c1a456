// Origin: where the zero of a store's space lies in the world. Immutable values.
//
// A scene that lies far out, such as a city in UTM or geocentric coordinates, loses half a metre to each float32 at
// 6400 km. So its positions are kept relative to an origin, which is subtracted in float64 before the one rounding to
// float32; rays are taken there in the same way. The origin itself is exact: whole steps of a power of two.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

namespace raymill::storage {

struct Origin {
  static constexpr std::int32_t kMostExponent = 100;  ///< of either sign

  std::array<std::int32_t, 3> steps{};
  std::int32_t exponent = 0;

  bool operator==(const Origin&) const = default;
  [[nodiscard]] bool is_zero() const { return steps == std::array<std::int32_t, 3>{}; }
  /// In the world; exact in float64.
  [[nodiscard]] std::array<double, 3> position() const {
    return {std::ldexp(steps[0], exponent), std::ldexp(steps[1], exponent), std::ldexp(steps[2], exponent)};
  }
};

/// The origin next to `position` that is a multiple of 2^exponent, or of the least larger power of two by which it can
/// be counted. Components are finite; what kMostExponent does not reach is zero.
inline Origin origin_near(const std::array<double, 3>& position, int exponent) {
  constexpr double kMostSteps = 0x7FFFFFFF;
  double most = 0;
  for (const double x : position) {
    most = std::fmax(most, std::fabs(x));
  }
  exponent = exponent < -Origin::kMostExponent ? -Origin::kMostExponent : exponent;
  while (exponent <= Origin::kMostExponent && std::ldexp(most, -exponent) > kMostSteps - 1) {
    ++exponent;
  }
  Origin origin;
  if (exponent > Origin::kMostExponent) {
    return origin;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    origin.steps[axis] = static_cast<std::int32_t>(std::nearbyint(std::ldexp(position[axis], -exponent)));
  }
  origin.exponent = origin.is_zero() ? 0 : exponent;
  return origin;
}

}  // namespace raymill::storage
