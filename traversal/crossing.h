// Which triangle of a surface a ray crosses where it meets an edge or a corner, in mode watertight. What that means
// stands in crossings.md. Compiled once, for the architecture's least machine. Immutable values.
#pragma once

#include <array>

namespace raymill::traversal {

/// The corners of a triangle in the plane across a ray, with the ray at the origin.
struct AcrossRay {
  std::array<double, 3> x, y;
};

/// u, v, w: across from corner 0, 1, 2.
struct EdgeFunctions {
  double u, v, w;
};

/// Whether the triangle has the crossing; decided exactly, and so is which edge function is zero. Coordinates are
/// multiples of 2^-478 below 2^131. Callers hold an IeeeScope.
bool owns_crossing(const AcrossRay& corners, EdgeFunctions& edges);

}  // namespace raymill::traversal
