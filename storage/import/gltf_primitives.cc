#include "storage/import/gltf_primitives.h"

#include <algorithm>
#include <vector>

#include "storage/import/gltf_accessor.h"
#include "storage/import/gltf_draco.h"
#include "storage/import/message.h"
#include "storage/import/primitive_readers.h"
#include "storage/import/release.h"
#include "storage/import/tinygltf_config.h"
#include "storage/import/triangle_assembler.h"

namespace raymill::storage {

namespace {

constexpr const char* kDraco = "KHR_draco_mesh_compression";

class PrimitiveImport {
 public:
  PrimitiveImport(const tinygltf::Primitive& primitive, PrimitiveMode mode, const Transform& world_from_node,
                  const PrimitiveContext& context)
      : primitive_(primitive),
        world_from_node_(world_from_node),
        context_(context),
        assembler_(mode, context.out),
        corners_(kPieceCorners) {}

  Status run(int position_accessor) {
    const int indices = GltfDocument::indices_of(primitive_);
    if (const auto draco = primitive_.extensions.find(kDraco); draco != primitive_.extensions.end()) {
      RAYMILL_RETURN_IF_ERROR(import_draco(draco->second, position_accessor));
    } else if (indices >= 0) {
      RAYMILL_RETURN_IF_ERROR(import_indexed(position_accessor, indices));
    } else {
      RAYMILL_RETURN_IF_ERROR(import_unindexed(position_accessor));
    }
    if (assembler_.leftover() != 0) {
      context_.report.counts[ImportCode::leftover_vertices] += assembler_.leftover();
    }
    return {};
  }

 private:
  Result<GltfAccessor> open_accessor(int index, std::uint32_t components) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, GltfAccessor::open(context_.document.model(), index, components,
                                                                       context_.buffers, context_.ledger));
    if (accessor.sparse()) {
      ++context_.report.counts[ImportCode::sparse_accessors];
    }
    return accessor;
  }

  Result<PositionReader> open_positions(int index) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, open_accessor(index, 3));
    RAYMILL_ASSIGN_OR_RETURN(
        PositionReader positions,
        PositionReader::open(std::move(accessor), context_.document.quantization(), world_from_node_));
    if (positions.accessor().type() != ComponentType::float32) {
      ++context_.report.counts[ImportCode::quantized_positions];
    }
    return positions;
  }

  // World positions of all vertices, claimed.
  Status hold_vertices(std::uint64_t count) {
    Result<BudgetReservation> claim = context_.ledger.claim(Tag::build, count * sizeof(Vec3f));
    if (!claim.ok()) {
      return in_context(message("its ", count, " vertices must be held in memory"), claim.status());
    }
    vertices_claim_ = std::move(claim).value();
    vertices_.resize(count);
    return {};
  }

  Status import_unindexed(int position_accessor) {
    RAYMILL_ASSIGN_OR_RETURN(PositionReader positions, open_positions(position_accessor));
    const std::uint64_t count = positions.accessor().count();
    for (std::uint64_t first = 0; first < count; first += kPieceCorners) {
      const auto piece = std::span(corners_).first(std::min<std::uint64_t>(kPieceCorners, count - first));
      RAYMILL_RETURN_IF_ERROR(positions.read(first, piece));
      RAYMILL_RETURN_IF_ERROR(assembler_.feed(piece));
    }
    return {};
  }

  Status import_indexed(int position_accessor, int index_accessor) {
    RAYMILL_ASSIGN_OR_RETURN(PositionReader positions, open_positions(position_accessor));
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, open_accessor(index_accessor, 1));
    RAYMILL_ASSIGN_OR_RETURN(IndexReader indices, IndexReader::open(std::move(accessor), positions.accessor().count()));
    RAYMILL_RETURN_IF_ERROR(hold_vertices(positions.accessor().count()));
    RAYMILL_RETURN_IF_ERROR(positions.read(0, vertices_));
    std::vector<std::uint32_t> numbers(kPieceCorners);
    const std::uint64_t count = indices.accessor().count();
    for (std::uint64_t first = 0; first < count; first += kPieceCorners) {
      const std::size_t taken = std::min<std::uint64_t>(kPieceCorners, count - first);
      RAYMILL_RETURN_IF_ERROR(indices.read(first, std::span(numbers).first(taken)));
      for (std::size_t i = 0; i < taken; ++i) {
        corners_[i] = vertices_[numbers[i]];
      }
      RAYMILL_RETURN_IF_ERROR(assembler_.feed(std::span(corners_).first(taken)));
    }
    return {};
  }

  // The stream's faces are a list whatever the primitive's mode: a strip is only how an encoder was fed.
  Status import_draco(const tinygltf::Value& extension, int position_accessor) {
    const tinygltf::Model& model = context_.document.model();
    const int view = extension.Get("bufferView").GetNumberAsInt();
    RAYMILL_ASSIGN_OR_RETURN(const ByteExtent extent, view_extent(model, view, context_.buffers));
    RAYMILL_ASSIGN_OR_RETURN(BudgetReservation stream_claim, context_.ledger.claim(Tag::build, extent.size_bytes));
    std::vector<std::byte> stream(extent.size_bytes);
    const int buffer = model.bufferViews[static_cast<std::size_t>(view)].buffer;
    RAYMILL_RETURN_IF_ERROR(context_.buffers.read(buffer, extent.offset, stream));

    const tinygltf::Value& attributes = extension.Get("attributes");
    if (!attributes.Has("POSITION")) {
      return bad_scene(kDraco, ".attributes has no POSITION");
    }
    const auto attribute_id = static_cast<std::uint32_t>(attributes.Get("POSITION").GetNumberAsInt());
    Result<DracoMesh> decoded = DracoMesh::decode(stream, attribute_id, context_.ledger);
    if (!decoded.ok()) {
      return in_context(message("bufferViews[", view, "]"), decoded.status());
    }
    release(stream);
    RAYMILL_RETURN_IF_ERROR(stream_claim.resize(0));
    return feed_faces(*decoded, model.accessors[static_cast<std::size_t>(position_accessor)].normalized);
  }

  Status feed_faces(const DracoMesh& mesh, bool normalized) {
    ++context_.report.counts[ImportCode::draco_primitives];
    RAYMILL_RETURN_IF_ERROR(hold_vertices(mesh.point_count()));
    for (std::uint32_t point = 0; point < mesh.point_count(); ++point) {
      vertices_[point] = round_once(world_from_node_.apply(mesh.position(point, normalized)));
    }
    for (std::uint32_t face = 0; face < mesh.face_count(); ++face) {
      const std::array<std::uint32_t, 3> points = mesh.face(face);
      const std::array<Vec3f, 3> corners = {vertices_[points[0]], vertices_[points[1]], vertices_[points[2]]};
      RAYMILL_RETURN_IF_ERROR(assembler_.feed(corners));
    }
    return {};
  }

  const tinygltf::Primitive& primitive_;
  const Transform& world_from_node_;
  const PrimitiveContext& context_;
  TriangleAssembler assembler_;
  std::vector<Vec3f> corners_;
  BudgetReservation vertices_claim_;
  std::vector<Vec3f> vertices_;
};

}  // namespace

Status import_primitive(const tinygltf::Primitive& primitive, const Transform& world_from_node,
                        const PrimitiveContext& context) {
  if (!primitive.targets.empty()) {
    ++context.report.counts[ImportCode::morph_at_rest];
  }
  if (primitive.mode > static_cast<int>(PrimitiveMode::triangle_fan)) {
    return bad_scene("mode is ", primitive.mode, ", which glTF 2.0 does not know");
  }
  auto mode = static_cast<PrimitiveMode>(primitive.mode);
  if (mode == PrimitiveMode::points) {
    ++context.report.counts[ImportCode::left_out_points];
    return {};
  }
  if (mode < PrimitiveMode::triangles) {
    ++context.report.counts[ImportCode::left_out_lines];
    return {};
  }
  const auto position = primitive.attributes.find("POSITION");
  if (position == primitive.attributes.end()) {
    ++context.report.counts[ImportCode::left_out_no_positions];
    return {};
  }
  if (primitive.extensions.contains(kDraco)) {
    if (mode == PrimitiveMode::triangle_fan) {
      return bad_scene(kDraco, " is used with a fan; only lists and strips may be compressed");
    }
    mode = PrimitiveMode::triangles;
  }
  return PrimitiveImport(primitive, mode, world_from_node, context).run(position->second);
}

}  // namespace raymill::storage
