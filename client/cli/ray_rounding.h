// How float64 rays become the float32 rays that are traced. This is the one place where it is said and done.
//
// - org and dir: each component to the nearest float32, ties to even. A ray starts up to half a unit in the last place
//   away from where it should (3 cm at a coordinate of 10^6 m), and dir turns by up to 2^-24. dir is not scaled, so t
//   counts in lengths of dir as it did.
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

namespace raymill::client {

struct WideRay {
  std::array<double, 3> org{};
  double tnear = 0;
  std::array<double, 3> dir{};
  double tfar = 0;
};

Ray round_ray(const WideRay& ray);

}  // namespace raymill::client
