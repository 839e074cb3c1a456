// Extent: a box in float64, and the sink that finds it. Thread-confined.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>

#include "storage/import/scene_import.h"
#include "storage/import/scene_origin.h"

namespace raymill::storage {

struct Extent {
  std::array<double, 3> lower{kNone, kNone, kNone};
  std::array<double, 3> upper{-kNone, -kNone, -kNone};

  void grow(const std::array<double, 3>& p) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      lower[axis] = std::min(lower[axis], p[axis]);
      upper[axis] = std::max(upper[axis], p[axis]);
    }
  }
  [[nodiscard]] bool empty() const { return !(lower[0] <= upper[0]); }
  [[nodiscard]] std::array<double, 3> middle() const {
    return {lower[0] + (upper[0] - lower[0]) / 2, lower[1] + (upper[1] - lower[1]) / 2,
            lower[2] + (upper[2] - lower[2]) / 2};
  }
  /// The largest.
  [[nodiscard]] double side() const {
    return std::max({upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]});
  }
  [[nodiscard]] bool is_far() const {
    const auto [x, y, z] = middle();
    return !empty() && std::isfinite(side()) &&
           std::max({std::fabs(x), std::fabs(y), std::fabs(z)}) > kFarSides * side();
  }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
};

/// Keeps where the triangles lie, and nothing else of them.
class ExtentSink final : public TriangleSink {
 public:
  /// What comes is relative to `origin`.
  ExtentSink(const std::array<double, 3>& origin, std::function<Status()> keep_going)
      : origin_(origin), keep_going_(std::move(keep_going)) {}

  Status add(std::span<const Triangle> triangles) override {
    for (const Triangle& triangle : triangles) {
      for (const Vec3f& p : triangle.v) {
        extent_.grow({origin_[0] + p.x, origin_[1] + p.y, origin_[2] + p.z});
      }
    }
    return keep_going_ ? keep_going_() : Status();
  }
  [[nodiscard]] const Extent& extent() const { return extent_; }

 private:
  const std::array<double, 3> origin_;
  const std::function<Status()> keep_going_;
  Extent extent_;
};

/// Where the meshes' nodes of a glTF stand, and what the first mesh takes where these are far out; nothing of a scene
/// whose nodes move no mesh. Errors: those of import_gltf().
Result<Extent> gltf_extent(const std::string& path, std::optional<std::uint32_t> scene, Ledger& ledger,
                           const std::function<Status()>& keep_going);

}  // namespace raymill::storage
