// Placement: the affine matrix that places an object in the world, and what it does to boxes. Immutable values.
#pragma once

#include <array>

#include "storage/base/vec3.h"

namespace raymill::storage {

/// Column-major 3 x 4: world = m[0..2] x + m[3..5] y + m[6..8] z + m[9..11].
using Placement = std::array<double, 12>;

/// Of the 3 x 3 part.
inline double determinant(const Placement& m) {
  return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[3] * (m[1] * m[8] - m[2] * m[7]) + m[6] * (m[1] * m[5] - m[2] * m[4]);
}

/// Whether rays can be taken into the object's space with little loss: all is finite, the columns are far enough from
/// one plane that the inverse in float64 is good to far more than float32, none is longer than 2^60, and no row of the
/// inverse is longer than 2^40, so that what is computed there stays within float32.
bool invertible(const Placement& placement);

/// A box in the world that holds the object's box as it is placed, and a float32 rounding of its points beside.
Aabb placed_box(const Placement& placement, const Aabb& object);

/// The box of an instance in a store whose rays may bring org in two parts, float32(org) and what that leaves; `reach`:
/// the largest magnitude of a coordinate in the scene.
///
/// In the world a ray goes from float32(org), which is up to 2^-24 |org| off along each axis; in the object it goes
/// from both parts. Where the true ray meets a box, the other one, moved by no more than that along each axis, meets
/// the box grown by as much, at the same t. So boxes that are grown by 2^-22 reach lose no hit of a ray that begins
/// within 4 reach of the origin along each axis, and the nodes above hold these boxes. Half of it, 2^-23 reach, is what
/// is promised (2 reach); the rest is room for the rounding of the box itself. A ray from further out is off by more,
/// and is so anyway by the rounding of its dir: it gets the hit of a ray within 2^-23 |org| of it.
Aabb widened_for_rays(const Aabb& box, float reach);

}  // namespace raymill::storage
