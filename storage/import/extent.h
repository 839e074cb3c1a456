// ExtentSink: where the triangles of a scene lie. What is seen of a glTF before it is imported. Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "storage/import/scene_import.h"
#include "storage/import/scene_origin.h"
#include "storage/import/scene_parts.h"

namespace raymill::storage {

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

/// `extent`: where the meshes' nodes of a glTF stand, and what the first mesh takes where these are far out; nothing of
/// a scene whose nodes move no mesh. `pieces`: the meshes as their nodes place them, by what their accessors say of
/// their least and most positions; those that say nothing, and those that EXT_mesh_gpu_instancing places, are left out.
/// Errors: those of import_gltf().
Result<SceneLook> look_at_gltf(const std::string& path, std::optional<std::uint32_t> scene, Ledger& ledger,
                               const std::function<Status()>& keep_going);

}  // namespace raymill::storage
