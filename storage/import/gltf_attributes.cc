#include "storage/import/gltf_attributes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "storage/import/attribute_vertices.h"
#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"
#include "storage/import/triangle_assembler.h"

namespace raymill::storage {
namespace {

// Triangles of vertices become entries.
class EntryWriter {
 public:
  EntryWriter(const AttributeVertices& vertices, AttributeSink& sink) : vertices_(vertices), sink_(sink) {}

  Status add(const std::array<std::uint32_t, 3>& corners) {
    for (const std::uint32_t corner : corners) {
      const auto values = vertices_.vertex(corner);
      piece_.insert(piece_.end(), values.begin(), values.end());
    }
    ++count;
    return piece_.size() >= kPieceFloats ? flush() : Status();
  }
  Status flush() {
    if (!piece_.empty()) {
      RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t at, sink_.add_entries(piece_));
      first = is_first_ ? at : first;
      is_first_ = false;
      piece_.clear();
    }
    return {};
  }

  std::uint64_t first = 0, count = 0;

 private:
  static constexpr std::size_t kPieceFloats = 1 << 14;
  const AttributeVertices& vertices_;
  AttributeSink& sink_;
  bool is_first_ = true;
  std::vector<float> piece_;
};

// The inverse transpose of the matrix up to a positive factor, column by column: its cofactors, with the sign of the
// determinant, the largest of them 1.
std::array<std::array<float, 3>, 3> normal_columns(const Transform& world_from_mesh) {
  const Placement m = placement_of(world_from_mesh);
  std::array<std::array<double, 3>, 3> columns{};
  double most = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t a = (i + 1) % 3 * 3, b = (i + 2) % 3 * 3;
    columns[i] = {m[a + 1] * m[b + 2] - m[a + 2] * m[b + 1], m[a + 2] * m[b] - m[a] * m[b + 2],
                  m[a] * m[b + 1] - m[a + 1] * m[b]};
    for (const double x : columns[i]) {
      most = std::max(most, std::fabs(x));
    }
  }
  std::array<std::array<float, 3>, 3> out{};
  if (!(most > 0) || !std::isfinite(most)) {
    return out;  // flat: no normal has a direction in the world
  }
  const double scale = determinant(m) < 0 ? -most : most;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      out[i][k] = static_cast<float>(columns[i][k] / scale);
    }
  }
  return out;
}

}  // namespace

Status GltfAttributes::place(int mesh, std::size_t primitive, std::uint32_t geometry_id,
                             const Transform& world_from_mesh) {
  auto made = made_.find({mesh, primitive});
  if (made == made_.end()) {
    RAYMILL_ASSIGN_OR_RETURN(const AttributeGeometry entries, make_entries(mesh, primitive));
    made = made_.emplace(std::pair(mesh, primitive), entries).first;
  }
  AttributeGeometry geometry = made->second;
  if (geometry.present == 0) {
    return {};
  }
  geometry.normal_columns = normal_columns(world_from_mesh);
  return config_.sink.set_attributes(geometry_id, geometry);
}

Result<AttributeGeometry> GltfAttributes::make_entries(int mesh, std::size_t primitive) {
  AttributeGeometry geometry;
  const PrimitiveAttributes* from = config_.document.attribute_sources().find(mesh, primitive);
  const tinygltf::Primitive& shape =
      config_.document.model().meshes[static_cast<std::size_t>(mesh)].primitives[primitive];
  if (from == nullptr || shape.mode < TINYGLTF_MODE_TRIANGLES || shape.mode > TINYGLTF_MODE_TRIANGLE_FAN ||
      !shape.attributes.contains("POSITION")) {
    return geometry;
  }
  RAYMILL_ASSIGN_OR_RETURN(
      AttributeVertices vertices,
      AttributeVertices::read({config_.document, config_.buffers, config_.ledger, config_.set}, *from, shape));
  if (vertices.present() != config_.set) {
    ++config_.report.counts[ImportCode::attributes_missing];
  }
  if (vertices.present() == 0) {
    return geometry;
  }
  if (const std::uint64_t count = vertices.not_finite(); count > 0) {
    config_.report.counts[ImportCode::attributes_not_finite] += count;
  }
  EntryWriter writer(vertices, config_.sink);
  CornerAssembler<std::uint32_t, EntryWriter> assembler(static_cast<PrimitiveMode>(vertices.mode()), writer);
  RAYMILL_RETURN_IF_ERROR(
      vertices.for_each_piece([&](std::span<const std::uint32_t> piece) { return assembler.feed(piece); }));
  RAYMILL_RETURN_IF_ERROR(writer.flush());
  if (writer.count >= std::numeric_limits<std::uint32_t>::max()) {
    return Status(ErrorCode::unsupported,
                  message("has ", writer.count, " triangles, more than primitive ids reach; split it"));
  }
  geometry.first_entry = writer.first;
  geometry.triangle_count = static_cast<std::uint32_t>(writer.count);
  geometry.present = writer.count > 0 ? vertices.present() : 0;
  return geometry;
}

}  // namespace raymill::storage
