// GltfPlacements: where a node puts its mesh: once, or as often as EXT_mesh_gpu_instancing says. Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "storage/base/status.h"
#include "storage/import/gltf_accessor.h"
#include "storage/import/gltf_primitives.h"
#include "storage/import/transform.h"

namespace tinygltf {
class Node;
}  // namespace tinygltf

namespace raymill::storage {

class GltfPlacements {
 public:
  /// Errors: bad_scene (accessors of other types or lengths), and those of the buffers.
  static Result<GltfPlacements> open(const tinygltf::Node& node, const Transform& world_from_node,
                                     const PrimitiveContext& context);

  [[nodiscard]] std::uint64_t count() const { return count_; }
  /// By EXT_mesh_gpu_instancing.
  [[nodiscard]] bool by_extension() const { return by_extension_; }
  /// Of placement `index`, in rising order. Errors: those of the buffers.
  Result<Transform> world_from_mesh(std::uint64_t index);

 private:
  static constexpr std::uint64_t kPieceElements = 4096;
  struct Attribute {
    std::optional<GltfAccessor> accessor;
    std::vector<std::byte> piece;
  };

  explicit GltfPlacements(const Transform& world_from_node) : world_from_node_(world_from_node) {}
  Status read_piece(std::uint64_t first);
  [[nodiscard]] double value(std::size_t attribute, std::uint64_t index, std::uint32_t component) const;

  Transform world_from_node_;
  bool by_extension_ = false;
  std::uint64_t count_ = 1;
  std::array<Attribute, 3> attributes_;  // translation, rotation, scale
  std::uint64_t first_ = 0, end_ = 0;    // of the piece
};

}  // namespace raymill::storage
