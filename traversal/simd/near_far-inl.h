// The near and the far planes of N boxes, for backends that keep them in two registers. Compiled once per ISA, after
// Floats.
#pragma once

#include <array>
#include <cstdint>

namespace raymill::traversal::RAYMILL_ISA {

template <int N>
struct NearFar {
  Floats<N> near_lanes, far_lanes;

  static NearFar broadcast(float near, float far) { return {Floats<N>::broadcast(near), Floats<N>::broadcast(far)}; }
  /// Planes of `axis`; the upper ones are near where the direction is `negative`.
  static NearFar from_bytes(const std::array<std::array<std::uint8_t, N>, 3>& lower,
                            const std::array<std::array<std::uint8_t, N>, 3>& upper, int axis, bool negative) {
    return {Floats<N>::from_bytes((negative ? upper : lower)[axis].data()),
            Floats<N>::from_bytes((negative ? lower : upper)[axis].data())};
  }
  /// N lower planes and then N upper ones; these are near where `negative` is 1.
  static NearFar load(const float* planes, unsigned negative) {
    return {Floats<N>::load(planes + N * negative), Floats<N>::load(planes + N * (negative ^ 1))};
  }
  [[nodiscard]] Floats<N> near() const { return near_lanes; }
  [[nodiscard]] Floats<N> far() const { return far_lanes; }
  /// Later near planes and earlier far planes replace those here; NaN does not.
  void tighten(const NearFar& planes) {
    near_lanes = max_keep(planes.near_lanes, near_lanes);
    far_lanes = min_keep(planes.far_lanes, far_lanes);
  }
};
template <int N>
NearFar<N> operator*(const NearFar<N>& planes, float x) {
  return {planes.near_lanes * Floats<N>::broadcast(x), planes.far_lanes * Floats<N>::broadcast(x)};
}
template <int N>
NearFar<N> operator+(const NearFar<N>& planes, float x) {
  return {planes.near_lanes + Floats<N>::broadcast(x), planes.far_lanes + Floats<N>::broadcast(x)};
}
template <int N>
NearFar<N> operator-(const NearFar<N>& planes, float x) {
  return {planes.near_lanes - Floats<N>::broadcast(x), planes.far_lanes - Floats<N>::broadcast(x)};
}

}  // namespace raymill::traversal::RAYMILL_ISA
