// Lanes of float32 in plain C++: the portable form of the kernels and the reference of the others.
//
// min_keep(a, b) and max_keep(a, b) give b where either is NaN, as MINPS and MAXPS do; every backend keeps that.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>

namespace raymill::traversal::scalar {

template <int N>
struct Floats {
  std::array<float, N> lane;

  static Floats broadcast(float x) {
    Floats r;
    r.lane.fill(x);
    return r;
  }
  static Floats from_bytes(const std::uint8_t* bytes) {
    Floats r;
    for (int i = 0; i < N; ++i) {
      r.lane[i] = float(bytes[i]);
    }
    return r;
  }
  /// lane i = base[index[i]]
  static Floats gather(const float* base, const std::array<std::int32_t, N>& index) {
    Floats r;
    for (int i = 0; i < N; ++i) {
      r.lane[i] = base[index[i]];
    }
    return r;
  }
  void store(float* out) const {
    for (int i = 0; i < N; ++i) {
      out[i] = lane[i];
    }
  }
};

#define RAYMILL_LANEWISE(name, expression)                        \
  template <int N>                                                \
  Floats<N> name(const Floats<N>& left, const Floats<N>& right) { \
    Floats<N> r;                                                  \
    for (int i = 0; i < N; ++i) {                                 \
      const float a = left.lane[i], b = right.lane[i];            \
      r.lane[i] = expression;                                     \
    }                                                             \
    return r;                                                     \
  }
RAYMILL_LANEWISE(operator+, a + b)
RAYMILL_LANEWISE(operator-, a - b)
RAYMILL_LANEWISE(operator*, a* b)
RAYMILL_LANEWISE(operator/, a / b)
RAYMILL_LANEWISE(min_keep, a < b ? a : b)
RAYMILL_LANEWISE(max_keep, a > b ? a : b)
#undef RAYMILL_LANEWISE

template <int N>
Floats<N> abs(const Floats<N>& x) {
  Floats<N> r;
  for (int i = 0; i < N; ++i) {
    r.lane[i] = std::bit_cast<float>(std::bit_cast<std::uint32_t>(x.lane[i]) & 0x7FFFFFFFU);
  }
  return r;
}

/// Bit i: a[i] <= b[i]; false for NaN. less(): a[i] < b[i].
template <int N>
unsigned less_equal(const Floats<N>& a, const Floats<N>& b) {
  unsigned mask = 0;
  for (int i = 0; i < N; ++i) {
    mask |= static_cast<unsigned>(a.lane[i] <= b.lane[i]) << i;
  }
  return mask;
}
template <int N>
unsigned less(const Floats<N>& a, const Floats<N>& b) {
  unsigned mask = 0;
  for (int i = 0; i < N; ++i) {
    mask |= static_cast<unsigned>(a.lane[i] < b.lane[i]) << i;
  }
  return mask;
}

}  // namespace raymill::traversal::scalar
