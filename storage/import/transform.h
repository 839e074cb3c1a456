// Transform: 3 x 4 affine matrices in float64, and the one rounding to float32. Immutable values.
#pragma once

#include <array>
#include <cmath>
#include <limits>

#include "storage/base/placement.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

struct Vec3d {
  double x = 0, y = 0, z = 0;
};

/// Column-major 4 x 4 matrix whose last row is 0 0 0 1: world = m * object.
struct Transform {
  std::array<double, 16> m = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

  [[nodiscard]] Vec3d apply(const Vec3d& p) const {
    return {m[0] * p.x + m[4] * p.y + m[8] * p.z + m[12], m[1] * p.x + m[5] * p.y + m[9] * p.z + m[13],
            m[2] * p.x + m[6] * p.y + m[10] * p.z + m[14]};
  }
  /// Into a space whose zero is `origin`.
  void move_back(const std::array<double, 3>& origin) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      m[12 + axis] -= origin[axis];
    }
  }
};

/// The same without the last row.
Placement placement_of(const Transform& transform);

/// Scale, then rotation by a quaternion x y z w of any length: q * p * q^-1 (Shoemake 1985), so rounding in the file
/// does not scale; then translation. A quaternion of zeros rotates nothing,
/// one that is not finite makes all NaN.
Transform from_trs(const Vec3d& translation, const std::array<double, 4>& rotation, const Vec3d& scale);

inline Transform operator*(const Transform& a, const Transform& b) {
  Transform product;
  for (std::size_t column = 0; column < 4; ++column) {
    for (std::size_t row = 0; row < 3; ++row) {
      double sum = column == 3 ? a.m[12 + row] : 0;
      for (std::size_t k = 0; k < 3; ++k) {
        sum += a.m[k * 4 + row] * b.m[column * 4 + k];
      }
      product.m[column * 4 + row] = sum;
    }
  }
  return product;
}

/// To nearest; a finite number beyond float32 becomes the largest float32, so that it stays told apart from infinity.
inline float round_once(double value) {
  constexpr double kMost = std::numeric_limits<float>::max();
  if (std::isfinite(value) && std::abs(value) > kMost) {
    return static_cast<float>(std::copysign(kMost, value));
  }
  return static_cast<float>(value);
}

inline Vec3f round_once(const Vec3d& p) { return {round_once(p.x), round_once(p.y), round_once(p.z)}; }

}  // namespace raymill::storage
