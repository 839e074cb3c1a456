// The triangle test of mode exact: the answer of exact arithmetic on float32 rays and corners. What it means stands in
// exact.md. Compiled once, for the architecture's least machine, so it is the same code whatever the kernel's ISA.
// Immutable values. Callers hold an IeeeScope.
#pragma once

#include <array>

namespace raymill::traversal {

using ExactCorners = std::array<std::array<float, 3>, 3>;

/// A valid ray's line (query.h).
struct ExactRay {
  std::array<float, 3> org;
  std::array<float, 3> dir;
};

/// Where a hit may lie. tfar is finite.
struct ExactInterval {
  float tnear;
  float tfar;
  /// tfar is the rounded t of a hit, not the ray's own: whatever rounds to it lies within, and exact_order() decides.
  bool tfar_is_hit;
};

struct ExactHit {
  float t = 0;          ///< of exact arithmetic, rounded to the nearest float32, ties to even; +0 for zero
  double u = 0, v = 0;  ///< off by less than 2^-22
};

/// False: no hit in the interval.
bool exact_hit(const ExactRay& ray, const ExactCorners& corners, const ExactInterval& interval, ExactHit& hit);

/// The same by the rule of crossings.md, by which a line that meets an edge or a corner meets one of the triangles of a
/// surface there and not all.
bool exact_crossing(const ExactRay& ray, const ExactCorners& corners, const ExactInterval& interval, ExactHit& hit);

/// Which triangle the ray meets first, before rounding: -1 a, 1 b, 0 both at the same t. It must hit both.
int exact_order(const ExactRay& ray, const ExactCorners& a, const ExactCorners& b);

}  // namespace raymill::traversal
