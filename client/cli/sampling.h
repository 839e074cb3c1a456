// Rays that leave a hit: where they begin and where they go. Pure functions.
#pragma once

#include <array>
#include <cstdint>

#include "client/cli/random.h"
#include "traversal/query.h"

namespace raymill::client {

using Vector3 = std::array<float, 3>;

struct Surface {
  Vector3
      origin;  ///< on the hit's side of the surface, off it by 2^-18 of the largest number the point is computed from
  Vector3 normal;  ///< of the side that the ray came from, length one
};

/// The point where `ray` met a triangle. Needs Field::t and Field::normal.
/// The point org + t dir is off by a few rounding errors of org and t dir; 2^-18 of the largest of them, 32 to 64 times
/// the error of one rounding, keeps what leaves here from meeting the same triangle again at all but grazing angles.
Surface surface_of(const Ray& ray, const Hit& hit);

/// A direction of the hemisphere around `normal` with density cos / pi (Malley's method on Duff et al. 2017's frame).
Vector3 cosine_direction(const Vector3& normal, Random& random);

}  // namespace raymill::client
