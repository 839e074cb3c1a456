// Closed meshes: whether one is, which parts of one are, and points that one encloses. Corners are the same vertex
// where their bits are. Pure functions.
#pragma once

#include <cstdint>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/scenes.h"

namespace raymill::bench {

using tests::Corners;
using tests::Mesh;
using tests::Vec3f;

/// Closed: each edge is passed as often in one direction as in the other, so that every way out of what the mesh winds
/// around meets a triangle.
struct Edges {
  std::uint64_t count = 0;     ///< without regard to direction
  std::uint64_t by_two = 0;    ///< of two triangles, one in each direction
  std::uint64_t by_more = 0;   ///< of four, six, ... triangles, half of them in each direction
  std::uint64_t unpaired = 0;  ///< the rest
  [[nodiscard]] bool closed() const { return count > 0 && unpaired == 0; }
};
Edges edges_of(const Mesh& mesh);

/// The parts, connected by shared vertices, that are closed; triangles stay in their order.
Mesh closed_parts(const Mesh& mesh);

/// The same surface without triangles that have no area, which an import drops: a closed mesh would be left with
/// vertices on the edges of others, and a watertight test with sums that do not match. Where two corners are equal the
/// triangle goes; else the edge across its middle corner is flipped. Those that have no neighbour there stay.
Mesh without_flat_triangles(const Mesh& mesh);

/// How often the mesh winds around `p`: the sum of the triangles' solid angles (Van Oosterom and Strackee 1983) over
/// 4 pi, in float64. Of a closed mesh it is a whole number, but for rounding.
double winding_number(const Mesh& mesh, const Vec3f& p);

/// `count` points that a closed mesh winds around, clear of its surface; each is a multiple of `step` in every
/// coordinate where that is not 0. Fewer where many tries find none.
std::vector<Vec3f> inside_points(const Mesh& mesh, tests::Random& random, std::size_t count, float step);

}  // namespace raymill::bench
