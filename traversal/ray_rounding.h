// How rays in float64 become the float32 rays that are traced, and how rays come to a store's origin. This is the one
// place where it is said and done.
//
// - org: org - origin, exactly, then to the nearest float32, ties to even. So a ray starts up to half a unit in the
//   last place of its distance from the origin away from where it should: 3 cm at 10^6 m from the world's zero, and
//   half a micrometre 10 m from the store's origin, wherever in the world that lies. What that leaves of org - origin,
//   rounded to float32 as well, goes with the ray where the store's parts have origins of their own: both together are
//   off by 2^-48 of the distance, 40 nm at 10^7 m.
// - dir: each component to the nearest float32: it turns by up to 2^-24. It is not scaled, so t counts in lengths of
//   dir as it did.
// - tnear up and tfar down: the float32 interval lies in the float64 one, so every hit has tnear <= t <= tfar in the
//   numbers of the file. Where no float32 lies between them, both go to the nearest, and t is within half a unit in the
//   last place of the interval.
// - What was invalid stays so: NaN, infinities, zero dir, crossed intervals. What float32 cannot hold becomes so: a
//   component of org or dir beyond its range is infinite, a dir of which every component is below 2^-150 is zero. An
//   end of the interval beyond the range is open (infinite, or the largest float32).
// Stateless.
#pragma once

#include <array>

#include "traversal/query.h"

namespace raymill::traversal {

/// `origin` is finite.
Ray round_ray(const Ray64& ray, const std::array<double, 3>& origin = {});

/// What float32 leaves of org - origin: org - origin - round_ray().org, to the nearest float32; 0 where that is not
/// finite.
std::array<float, 3> rest_of_org(const std::array<double, 3>& org, const std::array<double, 3>& origin);

/// The ray of world space in the space of a store with that origin; org alone changes.
Ray moved_ray(const Ray& ray, const std::array<double, 3>& origin);

}  // namespace raymill::traversal
