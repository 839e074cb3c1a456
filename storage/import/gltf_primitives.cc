#include "storage/import/gltf_primitives.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <vector>

#include "storage/import/gltf_accessor.h"
#include "storage/import/gltf_draco.h"
#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"
#include "storage/import/triangle_assembler.h"

namespace raymill::storage {

namespace {

constexpr const char* kDraco = "KHR_draco_mesh_compression";

// POSITION of a primitive in world space, by pieces.
class PositionReader {
 public:
  PositionReader(GltfAccessor accessor, const Transform& world_from_node)
      : accessor_(std::move(accessor)),
        world_from_node_(world_from_node),
        raw_(kPieceCorners * accessor_.element_bytes()) {}

  [[nodiscard]] const GltfAccessor& accessor() const { return accessor_; }

  Status read(std::uint64_t first, std::span<Vec3f> out) {
    for (std::size_t done = 0; done < out.size();) {
      const std::size_t taken = std::min(kPieceCorners, out.size() - done);
      const std::uint32_t element_bytes = accessor_.element_bytes();
      RAYMILL_RETURN_IF_ERROR(accessor_.read(first + done, std::span(raw_).first(taken * element_bytes)));
      for (std::size_t i = 0; i < taken; ++i) {
        out[done + i] = place(raw_.data() + i * element_bytes);
      }
      done += taken;
    }
    return {};
  }

 private:
  [[nodiscard]] Vec3f place(const std::byte* element) const {
    const std::uint32_t step = size_bytes(accessor_.type());
    const bool normalized = accessor_.normalized();
    const auto component = [&](std::uint32_t i) {
      return component_value(element + i * step, accessor_.type(), normalized);
    };
    return round_once(world_from_node_.apply({component(0), component(1), component(2)}));
  }

  GltfAccessor accessor_;
  const Transform& world_from_node_;
  std::vector<std::byte> raw_;
};

// The index accessor of a primitive, by pieces, each index checked against the vertices.
class IndexReader {
 public:
  IndexReader(GltfAccessor accessor, std::uint64_t vertex_count)
      : accessor_(std::move(accessor)), vertex_count_(vertex_count), raw_(kPieceCorners * accessor_.element_bytes()) {}

  static Result<GltfAccessor> open(int index, const PrimitiveContext& context) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor,
                             GltfAccessor::open(context.document.model(), index, 1, context.buffers, context.ledger));
    const ComponentType type = accessor.type();
    const bool known = type == ComponentType::uint8 || type == ComponentType::uint16 || type == ComponentType::uint32;
    if (!known || accessor.normalized()) {
      return bad_scene("accessors[", index, "] holds indices and must be of plain unsigned integers");
    }
    return accessor;
  }

  [[nodiscard]] const GltfAccessor& accessor() const { return accessor_; }

  Status read(std::uint64_t first, std::span<std::uint32_t> out) {
    RAYMILL_RETURN_IF_ERROR(accessor_.read(first, std::span(raw_).first(out.size() * accessor_.element_bytes())));
    switch (accessor_.type()) {
      case ComponentType::uint8:
        return convert<std::uint8_t>(first, out);
      case ComponentType::uint16:
        return convert<std::uint16_t>(first, out);
      default:
        return convert<std::uint32_t>(first, out);
    }
  }

 private:
  template <typename T>
  Status convert(std::uint64_t first, std::span<std::uint32_t> out) const {
    for (std::size_t i = 0; i < out.size(); ++i) {
      T index;
      std::memcpy(&index, raw_.data() + i * sizeof index, sizeof index);
      if (index == std::numeric_limits<T>::max()) {
        return bad_scene("accessors[", accessor_.index(), "] holds the primitive restart value ", index, " at ",
                         first + i, ", which glTF 2.0 forbids");
      }
      if (index >= vertex_count_) {
        return bad_scene("accessors[", accessor_.index(), "] holds index ", index, " at ", first + i,
                         " and the primitive has only ", vertex_count_, " vertices");
      }
      out[i] = index;
    }
    return {};
  }

  GltfAccessor accessor_;
  std::uint64_t vertex_count_;
  std::vector<std::byte> raw_;
};

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
  Result<GltfAccessor> open_positions(int index) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, GltfAccessor::open(context_.document.model(), index, 3,
                                                                       context_.buffers, context_.ledger));
    if (accessor.type() != ComponentType::float32) {
      if (!context_.document.quantization() || accessor.type() == ComponentType::uint32) {
        return bad_scene(
            "accessors[", index, "] holds positions of component type ", static_cast<int>(accessor.type()), ", which ",
            accessor.type() == ComponentType::uint32 ? "glTF 2.0 does not allow" : "only KHR_mesh_quantization allows");
      }
      ++context_.report.counts[ImportCode::quantized_positions];
    }
    if (accessor.sparse()) {
      ++context_.report.counts[ImportCode::sparse_accessors];
    }
    return accessor;
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
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, open_positions(position_accessor));
    PositionReader positions(std::move(accessor), world_from_node_);
    const std::uint64_t count = positions.accessor().count();
    for (std::uint64_t first = 0; first < count; first += kPieceCorners) {
      const auto piece = std::span(corners_).first(std::min<std::uint64_t>(kPieceCorners, count - first));
      RAYMILL_RETURN_IF_ERROR(positions.read(first, piece));
      RAYMILL_RETURN_IF_ERROR(assembler_.feed(piece));
    }
    return {};
  }

  Status import_indexed(int position_accessor, int index_accessor) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, open_positions(position_accessor));
    PositionReader positions(std::move(accessor), world_from_node_);
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor index_elements, IndexReader::open(index_accessor, context_));
    IndexReader indices(std::move(index_elements), positions.accessor().count());
    if (indices.accessor().sparse()) {
      ++context_.report.counts[ImportCode::sparse_accessors];
    }
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
    stream = {};
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
