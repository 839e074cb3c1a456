#include "storage/import/attribute_vertices.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "storage/import/accessor_elements.h"
#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"
#include "storage/import/transform.h"

namespace raymill::storage {
namespace {

constexpr const char* kDracoStream = "KHR_draco_mesh_compression";
constexpr std::size_t kMostComponents = 4;

const char* remedy() { return "; mend it, or leave the attribute out of --attributes"; }

bool is_of_type(const tinygltf::Accessor& accessor, Attribute attribute) {
  switch (attribute) {
    case Attribute::normal:
      return accessor.type == TINYGLTF_TYPE_VEC3;
    case Attribute::color0:
      return accessor.type == TINYGLTF_TYPE_VEC3 || accessor.type == TINYGLTF_TYPE_VEC4;
    default:
      return accessor.type == TINYGLTF_TYPE_VEC2;
  }
}

// glTF 2.0, 3.7.2.1, and what KHR_mesh_quantization adds.
bool is_of_component(Attribute attribute, ComponentType type, bool normalized, bool quantization) {
  if (type == ComponentType::float32) {
    return true;
  }
  const bool is_unsigned = type == ComponentType::uint8 || type == ComponentType::uint16;
  const bool is_signed = type == ComponentType::int8 || type == ComponentType::int16;
  switch (attribute) {
    case Attribute::normal:
      return quantization && normalized && is_signed;
    case Attribute::color0:
      return normalized && is_unsigned;
    default:
      return (normalized && is_unsigned) || (quantization && (is_signed || is_unsigned));
  }
}

// A colour without alpha is opaque.
void take_components(Attribute attribute, std::size_t components, std::span<const double> values, float* out) {
  for (std::size_t i = 0; i < kind_of(attribute).floats; ++i) {
    out[i] = i < components ? round_once(values[i]) : 1.0F;
  }
}

}  // namespace

Result<AttributeVertices> AttributeVertices::read(const Source& source, const PrimitiveAttributes& from,
                                                  const tinygltf::Primitive& primitive) {
  AttributeVertices vertices;
  vertices.set_ = source.set;
  vertices.floats_ = corner_floats(source.set);
  vertices.mode_ = primitive.mode;
  for (const Attribute attribute : kAttributes) {
    const AttributeSource& of = from[static_cast<std::size_t>(attribute)];
    if (of.accessor == AttributeSource::kBroken) {
      return bad_scene(kind_of(attribute).gltf_name, " names no accessor of the file", remedy());
    }
    vertices.present_ |= of.accessor >= 0 ? bit_of(attribute) : 0;
  }
  if (vertices.present_ == 0) {
    return vertices;
  }
  RAYMILL_RETURN_IF_ERROR(primitive.extensions.contains(kDracoStream)
                              ? vertices.read_draco(source, from, primitive)
                              : vertices.read_vertices(source, from, primitive));
  return vertices;
}

Status AttributeVertices::hold(Ledger& ledger, std::uint64_t count) {
  if (count > std::numeric_limits<std::uint32_t>::max()) {
    return {ErrorCode::unsupported,
            message("has ", count, " vertices, more than their attributes are read of; split it")};
  }
  constexpr std::uint64_t kScratchBytes = kPieceCorners * (kMostComponents * sizeof(float) + 2 * sizeof(std::uint32_t));
  Result<BudgetReservation> claim = ledger.claim(Tag::build, count * floats_ * sizeof(float) + kScratchBytes);
  if (!claim.ok()) {
    return in_context(message("attributes of its ", count, " vertices must be held in memory"), claim.status());
  }
  claim_ = std::move(*claim);
  count_ = count;
  values_.resize(count * floats_);
  return {};
}

Status AttributeVertices::read_vertices(const Source& source, const PrimitiveAttributes& from,
                                        const tinygltf::Primitive& primitive) {
  const tinygltf::Model& model = source.document.model();
  const auto position = static_cast<std::size_t>(primitive.attributes.at("POSITION"));
  RAYMILL_RETURN_IF_ERROR(hold(source.ledger, model.accessors[position].count));
  for (const Attribute attribute : kAttributes) {
    if (holds(present_, attribute)) {
      RAYMILL_RETURN_IF_ERROR(read_accessor(source, attribute, from[static_cast<std::size_t>(attribute)].accessor));
    }
  }
  if (const int index = GltfDocument::indices_of(primitive); index >= 0) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, GltfAccessor::open(model, index, 1, source.buffers, source.ledger));
    RAYMILL_ASSIGN_OR_RETURN(IndexReader reader, IndexReader::open(std::move(accessor), count_));
    indices_.emplace(std::move(reader));
  }
  return {};
}

Status AttributeVertices::read_accessor(const Source& source, Attribute attribute, int index) {
  const tinygltf::Model& model = source.document.model();
  const AttributeKind& kind = kind_of(attribute);
  const tinygltf::Accessor& declared = model.accessors[static_cast<std::size_t>(index)];
  if (!is_of_type(declared, attribute)) {
    return bad_scene("accessors[", index, "] is of no type that ", kind.gltf_name, " may have", remedy());
  }
  const std::uint32_t components = declared.type == TINYGLTF_TYPE_VEC4   ? 4
                                   : declared.type == TINYGLTF_TYPE_VEC3 ? 3
                                                                         : 2;
  RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor,
                           GltfAccessor::open(model, index, components, source.buffers, source.ledger));
  if (!is_of_component(attribute, accessor.type(), accessor.normalized(), source.document.quantization())) {
    return bad_scene("accessors[", index, "] holds ", kind.gltf_name,
                     " as integers of a kind that glTF does not allow for it", remedy());
  }
  if (accessor.count() != count_) {
    return bad_scene("accessors[", index, "] has ", accessor.count(), " elements of ", kind.gltf_name, " for ", count_,
                     " vertices", remedy());
  }
  return for_each_element<kMostComponents>(std::move(accessor), [&](std::uint64_t vertex, const auto& values) {
    take_components(attribute, components, values, place(attribute, vertex));
  });
}

Status AttributeVertices::take_faces(const DracoMesh& mesh, Ledger& ledger) {
  RAYMILL_RETURN_IF_ERROR(hold(ledger, mesh.point_count()));
  RAYMILL_ASSIGN_OR_RETURN(faces_claim_,
                           ledger.claim(Tag::build, 3 * sizeof(std::uint32_t) * std::uint64_t{mesh.face_count()}));
  faces_.reserve(std::size_t{3} * mesh.face_count());
  for (std::uint32_t face = 0; face < mesh.face_count(); ++face) {
    const auto points = mesh.face(face);
    faces_.insert(faces_.end(), points.begin(), points.end());
  }
  has_faces_ = true;
  return {};
}

// A stream's points have an order of their own, so what stands beside it cannot be told whose it is.
Status AttributeVertices::read_draco(const Source& source, const PrimitiveAttributes& from,
                                     const tinygltf::Primitive& primitive) {
  mode_ = TINYGLTF_MODE_TRIANGLES;
  const tinygltf::Model& model = source.document.model();
  const int view = primitive.extensions.at(kDracoStream).Get("bufferView").GetNumberAsInt();
  RAYMILL_ASSIGN_OR_RETURN(const ByteExtent extent, view_extent(model, view, source.buffers));
  RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation stream_claim, source.ledger.claim(Tag::build, extent.size_bytes));
  std::vector<std::byte> stream(extent.size_bytes);
  RAYMILL_RETURN_IF_ERROR(
      source.buffers.read(model.bufferViews[static_cast<std::size_t>(view)].buffer, extent.offset, stream));
  for (const Attribute attribute : kAttributes) {
    if (!holds(present_, attribute)) {
      continue;
    }
    const AttributeSource& of = from[static_cast<std::size_t>(attribute)];
    const tinygltf::Accessor& declared = model.accessors[static_cast<std::size_t>(of.accessor)];
    if (of.draco < 0) {
      return {ErrorCode::unsupported, message(kind_of(attribute).gltf_name,
                                              " of a primitive that Draco compresses "
                                              "stands outside its stream; compress it too, or leave the attribute out "
                                              "of --attributes")};
    }
    if (!is_of_type(declared, attribute)) {
      return bad_scene("accessors[", of.accessor, "] is of no type that ", kind_of(attribute).gltf_name, " may have",
                       remedy());
    }
    const std::uint32_t components = declared.type == TINYGLTF_TYPE_VEC4   ? 4
                                     : declared.type == TINYGLTF_TYPE_VEC3 ? 3
                                                                           : 2;
    Result<DracoMesh> mesh =
        DracoMesh::decode(stream, {static_cast<std::uint32_t>(of.draco), components}, source.ledger);
    if (!mesh.ok()) {
      return in_context(message("bufferViews[", view, "]"), mesh.status());
    }
    if (!has_faces_) {
      RAYMILL_RETURN_IF_ERROR(take_faces(*mesh, source.ledger));
    }
    for (std::uint32_t point = 0; point < mesh->point_count(); ++point) {
      take_components(attribute, components, mesh->values(point, declared.normalized), place(attribute, point));
    }
  }
  return {};
}

std::uint64_t AttributeVertices::not_finite() const {
  std::uint64_t vertices = 0;
  for (std::uint64_t i = 0; i < count_; ++i) {
    const auto values = vertex(static_cast<std::uint32_t>(i));
    vertices += std::any_of(values.begin(), values.end(), [](float value) { return !std::isfinite(value); }) ? 1 : 0;
  }
  return vertices;
}

Status AttributeVertices::for_each_piece(const std::function<Status(std::span<const std::uint32_t>)>& take) {
  if (has_faces_) {
    return take(faces_);
  }
  std::vector<std::uint32_t> numbers(kPieceCorners);
  const std::uint64_t count = indices_ ? indices_->accessor().count() : count_;
  for (std::uint64_t first = 0; first < count; first += kPieceCorners) {
    const auto piece = std::span(numbers).first(std::min<std::uint64_t>(kPieceCorners, count - first));
    if (indices_) {
      RAYMILL_RETURN_IF_ERROR(indices_->read(first, piece));
    } else {
      for (std::size_t i = 0; i < piece.size(); ++i) {
        piece[i] = static_cast<std::uint32_t>(first + i);
      }
    }
    RAYMILL_RETURN_IF_ERROR(take(piece));
  }
  return {};
}

}  // namespace raymill::storage
