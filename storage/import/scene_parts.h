// Parts of a scene that lie so far apart that float32 in one space would lose them: two towns, an ocean between them.
//
//   boxes of meshes as they are placed --cut wherever nothing lies for 1/256 of the scene's reach--> parts
//
// A part that is small beside its distance gets an origin of its own: its triangles are kept relative to that, as an
// object that is placed once, by a matrix of float64. Between parts there is nothing, so none of them shares a corner
// with another or with the rest of the scene, and no crack can come of it that two of them round differently. A mesh is
// never cut: one that itself spans such distances stays in the scene's own space.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "storage/base/origin.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

/// Something lies far out where its middle is further from zero than this many times its largest side: a step of
/// float32 there is more than 2^-18 of its size.
constexpr double kFarSides = 64;
/// Nearer to zero than this float32 is good to a thousandth of a unit, a millimetre where units are metres as in glTF;
/// no part is made there.
constexpr double kNearReach = 1 << 14;

/// A box in float64. Thread-compatible.
struct Extent {
  std::array<double, 3> lower{kNone, kNone, kNone};
  std::array<double, 3> upper{-kNone, -kNone, -kNone};

  void grow(const std::array<double, 3>& p) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      lower[axis] = std::min(lower[axis], p[axis]);
      upper[axis] = std::max(upper[axis], p[axis]);
    }
  }
  void join(const Extent& other) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      lower[axis] = std::min(lower[axis], other.lower[axis]);
      upper[axis] = std::max(upper[axis], other.upper[axis]);
    }
  }
  [[nodiscard]] bool empty() const { return !(lower[0] <= upper[0]); }
  [[nodiscard]] bool finite() const {
    return std::all_of(lower.begin(), lower.end(), [](double x) { return std::isfinite(x); }) &&
           std::all_of(upper.begin(), upper.end(), [](double x) { return std::isfinite(x); });
  }
  [[nodiscard]] std::array<double, 3> middle() const {
    return {lower[0] + (upper[0] - lower[0]) / 2, lower[1] + (upper[1] - lower[1]) / 2,
            lower[2] + (upper[2] - lower[2]) / 2};
  }
  /// The largest.
  [[nodiscard]] double side() const {
    return std::max({upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]});
  }
  /// The largest magnitude of a coordinate.
  [[nodiscard]] double reach() const {
    double most = 0;
    for (std::size_t axis = 0; axis < 3 && !empty(); ++axis) {
      most = std::max({most, std::fabs(lower[axis]), std::fabs(upper[axis])});
    }
    return most;
  }
  [[nodiscard]] bool is_far() const {
    const auto [x, y, z] = middle();
    return !empty() && std::isfinite(side()) &&
           std::max({std::fabs(x), std::fabs(y), std::fabs(z)}) > kFarSides * side();
  }
  /// The same box in a space whose zero is `origin`.
  [[nodiscard]] Extent relative_to(const std::array<double, 3>& origin) const {
    Extent moved;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      moved.lower[axis] = lower[axis] - origin[axis];
      moved.upper[axis] = upper[axis] - origin[axis];
    }
    return moved;
  }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
};

/// Something of a scene that is not cut: a mesh as a node places it, or a file.
struct ScenePiece {
  Extent box;
  bool gains = true;  ///< its numbers hold more than float32 does where it stands
};

/// What is kept relative to an origin of its own. Relative to the scene's.
struct ScenePart {
  Extent around;  ///< holds the middle of each of its meshes, and that of no other mesh
  Origin origin;
};

constexpr std::size_t kMostParts = 256;
constexpr std::uint32_t kNoPart = 0xFFFFFFFF;

/// The parts of a scene that need origins of their own, at most kMostParts, rising by where they stand; none where the
/// scene reaches no further than kNearReach, or none of its pieces gains. `pieces`: all of the scene, relative to its
/// origin; those whose boxes are empty or not finite do not count. Where there would be more parts, gaps must be wider.
std::vector<ScenePart> find_parts(std::vector<ScenePiece> pieces);
/// The part that a mesh with this box is in; kNoPart: none.
std::uint32_t part_of(std::span<const ScenePart> parts, const Extent& box);

/// Takes triangles part by part. Called from the thread that calls the TriangleSink.
class PartSink {
 public:
  virtual ~PartSink() = default;
  /// Triangles that come from here on are in the space of that part; kNoPart: in the scene's own.
  virtual void enter_part(std::uint32_t part) = 0;
};

}  // namespace raymill::storage
