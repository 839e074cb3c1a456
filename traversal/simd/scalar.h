// Lanes of float32 in plain C++: the portable form of the kernels and the reference of the others.
//
// min_keep(a, b) and max_keep(a, b) give b where either is NaN, as MINPS and MAXPS do; every backend keeps that.
#pragma once

#include <array>
#include <bit>
#include <cmath>
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
  static Floats load(const float* from) {
    Floats r;
    for (int i = 0; i < N; ++i) {
      r.lane[i] = from[i];
    }
    return r;
  }
  static Floats from_bytes(const std::uint8_t* bytes) {
    Floats r;
    for (int i = 0; i < N; ++i) {
      r.lane[i] = float(bytes[i]);
    }
    return r;
  }
  /// x, y and z of the points at base + index[i]; backends may read one float past a point.
  static std::array<Floats, 3> points(const float* base, const std::array<std::int32_t, N>& index) {
    std::array<Floats, 3> r;
    for (int i = 0; i < N; ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        r[axis].lane[i] = base[index[i] + axis];
      }
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

/// Lane i: a[i], or b[i] where the sign of sign[i] is set.
template <int N>
Floats<N> select_by_sign(const Floats<N>& sign, const Floats<N>& a, const Floats<N>& b) {
  Floats<N> r;
  for (int i = 0; i < N; ++i) {
    r.lane[i] = std::signbit(sign.lane[i]) ? b.lane[i] : a.lane[i];
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

/// Corner k of triangle i < count is index[k][i] * 3 floats into the vertices, from three indices for each triangle;
/// those past the last are the first triangle's. 1 <= count <= 8.
inline void corner_indices(const std::uint16_t* indices, unsigned count,
                           std::array<std::array<std::int32_t, 8>, 3>& index) {
  for (unsigned i = 0; i < 8; ++i) {
    const unsigned from = i < count ? i : 0;
    for (unsigned k = 0; k < 3; ++k) {
      index[k][i] = indices[from * 3 + k] * 3;
    }
  }
}

}  // namespace raymill::traversal::scalar

#include "traversal/simd/near_far-inl.h"
