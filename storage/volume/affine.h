// Affine maps in float64. Stateless.
#pragma once

#include <array>
#include <cmath>
#include <optional>

#include "storage/base/volume.h"

namespace raymill::storage {

using Point3 = std::array<double, 3>;

/// The map of a point.
inline Point3 map_point(const Affine& map, const Point3& p) {
  Point3 out{};
  for (std::size_t row = 0; row < 3; ++row) {
    out[row] = map[row][0] * p[0] + map[row][1] * p[1] + map[row][2] * p[2] + map[row][3];
  }
  return out;
}

/// The map of a direction.
inline Point3 map_direction(const Affine& map, const Point3& d) {
  Point3 out{};
  for (std::size_t row = 0; row < 3; ++row) {
    out[row] = map[row][0] * d[0] + map[row][1] * d[1] + map[row][2] * d[2];
  }
  return out;
}

/// First `inner`, then `outer`.
inline Affine compose(const Affine& outer, const Affine& inner) {
  Affine out{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      out[row][column] = outer[row][0] * inner[0][column] + outer[row][1] * inner[1][column] +
                         outer[row][2] * inner[2][column] + (column == 3 ? outer[row][3] : 0);
    }
  }
  return out;
}

/// By cofactors; none where the map has no inverse that float64 holds.
inline std::optional<Affine> inverse_of(const Affine& m) {
  const auto minor = [&m](std::size_t row, std::size_t column) {
    const std::size_t r0 = (row + 1) % 3, r1 = (row + 2) % 3, c0 = (column + 1) % 3, c1 = (column + 2) % 3;
    return m[r0][c0] * m[r1][c1] - m[r0][c1] * m[r1][c0];
  };
  const double determinant = m[0][0] * minor(0, 0) + m[0][1] * minor(0, 1) + m[0][2] * minor(0, 2);
  Affine out{};
  bool finite = determinant != 0;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      out[row][column] = minor(column, row) / determinant;
    }
    out[row][3] = -(out[row][0] * m[0][3] + out[row][1] * m[1][3] + out[row][2] * m[2][3]);
    for (const double entry : out[row]) {
      finite = finite && std::isfinite(entry);
    }
  }
  return finite ? std::optional(out) : std::nullopt;
}

}  // namespace raymill::storage
