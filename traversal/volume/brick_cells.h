// BrickCells: the cells of a brick that a ray passes, and the field in each. Stateless, but for the brick it looks at.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

#include "storage/volume/volume_page.h"
#include "traversal/volume/volume_ray.h"

namespace raymill::traversal {

using Cell = std::array<std::int32_t, 3>;  ///< in the brick, 0 to 7 along each axis

class BrickCells {
 public:
  BrickCells(const storage::VolumePageView& page, const storage::Brick& brick, float step, const VolumeRay& ray)
      : values_(page, brick, step), brick_(brick), ray_(ray) {}

  /// Values at the corners of a cell; corner = x + 2 (y + 2 z).
  [[nodiscard]] std::array<double, 8> corners(const Cell& cell) const {
    std::array<double, 8> values{};
    for (int corner = 0; corner < 8; ++corner) {
      values[static_cast<std::size_t>(corner)] = values_.at(
          cell[0] + (corner & 1) +
          storage::kBrickCorners * (cell[1] + (corner >> 1 & 1) + storage::kBrickCorners * (cell[2] + (corner >> 2))));
    }
    return values;
  }
  /// Where the ray is in the cell at t, 0 to 1 along each axis but for rounding.
  [[nodiscard]] std::array<double, 3> place(const Cell& cell, double t) const {
    std::array<double, 3> p{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      p[axis] = ray_.at(axis, t) - (double(brick_.origin[axis]) + cell[axis]);
    }
    return p;
  }
  static double trilinear(const std::array<double, 8>& v, const std::array<double, 3>& p) {
    const double x0 = v[0] + (v[1] - v[0]) * p[0], x1 = v[2] + (v[3] - v[2]) * p[0];
    const double x2 = v[4] + (v[5] - v[4]) * p[0], x3 = v[6] + (v[7] - v[6]) * p[0];
    const double y0 = x0 + (x1 - x0) * p[1], y1 = x2 + (x3 - x2) * p[1];
    return y0 + (y1 - y0) * p[2];
  }
  /// The field's value at t.
  [[nodiscard]] double value(double t) const {
    const Cell cell = cell_at(t);
    return trilinear(corners(cell), place(cell, t));
  }
  [[nodiscard]] Cell cell_at(double t) const {
    Cell cell{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double offset = ray_.at(axis, t) - brick_.origin[axis];
      cell[axis] = offset >= 1 ? static_cast<std::int32_t>(std::min(offset, storage::kBrickCells - 1.0)) : 0;
    }
    return cell;
  }

  /// Calls visit(cell, begin, end) for each cell in the ray's order until it returns false.
  template <typename Visit>
  void each(const Interval& in, Visit&& visit) const {
    Cell cell{};
    std::array<double, 3> exit{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      cell[axis] = ray_.part(axis, brick_.origin[axis], 1, storage::kBrickCells, in.begin);
      exit[axis] = exit_of(axis, cell[axis]);
    }
    for (double t = in.begin; t < in.end;) {
      const double end = std::min({exit[0], exit[1], exit[2], in.end});
      if (end > t && !visit(cell, t, end)) {
        return;
      }
      bool inside = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (exit[axis] <= end) {
          cell[axis] += ray_.forward(axis) ? 1 : -1;
          inside = inside && cell[axis] >= 0 && cell[axis] < storage::kBrickCells;
          exit[axis] = exit_of(axis, cell[axis]);
        }
      }
      if (!inside) {
        return;  // at the brick's end
      }
      t = end;
    }
  }

 private:
  [[nodiscard]] double exit_of(std::size_t axis, std::int32_t cell) const {
    return ray_.parallel(axis) ? std::numeric_limits<double>::infinity()
                               : ray_.plane(axis, brick_.origin[axis] + cell + (ray_.forward(axis) ? 1 : 0));
  }

  storage::BrickValues values_;
  const storage::Brick& brick_;
  const VolumeRay& ray_;
};

}  // namespace raymill::traversal
