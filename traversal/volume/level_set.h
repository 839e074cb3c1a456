// Where a ray crosses the zero of a trilinear field. Stateless.
#pragma once

#include <array>
#include <optional>

#include "storage/volume/affine.h"
#include "traversal/volume/brick_cells.h"

namespace raymill::traversal {

/// Which side a value lies on: 1 outside, 0 included, -1 inside.
inline double side_of(double value) { return value < 0 ? -1 : 1; }

/// A cell's field as x, y, z of the cell.
class TrilinearCell {
 public:
  explicit TrilinearCell(const std::array<double, 8>& v)
      : one_(v[0]),
        x_(v[1] - v[0]),
        y_(v[2] - v[0]),
        z_(v[4] - v[0]),
        xy_(v[3] - v[1] - v[2] + v[0]),
        xz_(v[5] - v[1] - v[4] + v[0]),
        yz_(v[6] - v[2] - v[4] + v[0]),
        xyz_(v[7] - v[6] - v[5] - v[3] + v[1] + v[2] + v[4] - v[0]) {}

  [[nodiscard]] storage::Point3 gradient(const std::array<double, 3>& p) const {
    return {x_ + xy_ * p[1] + xz_ * p[2] + xyz_ * p[1] * p[2], y_ + xy_ * p[0] + yz_ * p[2] + xyz_ * p[0] * p[2],
            z_ + xz_ * p[0] + yz_ * p[1] + xyz_ * p[0] * p[1]};
  }
  /// The cubic in s along the way from a to a + b: Marmitt et al. 2004.
  [[nodiscard]] std::array<double, 4> along(const std::array<double, 3>& a, const std::array<double, 3>& b) const;

 private:
  double one_, x_, y_, z_, xy_, xz_, yz_, xyz_;
};

/// The least s in [0, 1] at which the cubic changes its side; none where it does not. Where it touches zero and turns
/// back it does not.
std::optional<double> first_change(const std::array<double, 4>& cubic);

/// All of them, rising; 2 in the place of those that there are not.
std::array<double, 3> changes_of(const std::array<double, 4>& cubic);

/// A ray on its way through a level set. `side`: where it was before the brick, 0 where that is not known; where it is
/// after. A change of side between bricks or cells, as rounding may make, is a crossing too, so no ray slips through.
struct SurfaceCrossing {
  double t = 0;
  storage::Point3 gradient{};  ///< in index space
};
std::optional<SurfaceCrossing> first_crossing(const BrickCells& cells, const Interval& in, double& side);

}  // namespace raymill::traversal
