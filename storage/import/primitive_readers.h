// PositionReader, IndexReader: what a primitive is made of, by pieces. Thread-confined.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/import/gltf_accessor.h"
#include "storage/import/transform.h"

namespace raymill::storage {

/// Corners that are looked up at once.
constexpr std::size_t kPieceCorners = 16384;

/// POSITION in world space: float64 through the node's matrix, rounded once.
class PositionReader {
 public:
  /// Integer positions are taken where `quantization` (KHR_mesh_quantization) allows them. Errors: bad_scene.
  static Result<PositionReader> open(GltfAccessor accessor, bool quantization, const Transform& world_from_node);

  [[nodiscard]] const GltfAccessor& accessor() const { return accessor_; }
  /// Vertices first .. first + out.size(), which must lie below the accessor's count. Errors: those of the buffers.
  Status read(std::uint64_t first, std::span<Vec3f> out);

 private:
  PositionReader(GltfAccessor accessor, const Transform& world_from_node);
  [[nodiscard]] Vec3f place(const std::byte* element) const;

  GltfAccessor accessor_;
  Transform world_from_node_;
  std::vector<std::byte> raw_;
};

/// An index accessor, each index checked against the number of vertices.
class IndexReader {
 public:
  /// Errors: bad_scene (not plain unsigned integers; nothing but zeros).
  static Result<IndexReader> open(GltfAccessor accessor, std::uint64_t vertex_count);

  [[nodiscard]] const GltfAccessor& accessor() const { return accessor_; }
  /// At most kPieceCorners indices from `first`. Errors: bad_scene (past the vertices; a primitive restart value), and
  /// those of the buffers.
  Status read(std::uint64_t first, std::span<std::uint32_t> out);

 private:
  IndexReader(GltfAccessor accessor, std::uint64_t vertex_count);
  template <typename T>
  Status convert(std::uint64_t first, std::span<std::uint32_t> out) const;

  GltfAccessor accessor_;
  std::uint64_t vertex_count_;
  std::vector<std::byte> raw_;
};

}  // namespace raymill::storage
