#include "storage/import/gltf_draco.h"

#include <draco/compression/decode.h>
#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <draco/compression/mesh/mesh_sequential_decoder.h>
#include <draco/core/varint_decoding.h>
#include <draco/metadata/metadata_decoder.h>

#include <algorithm>
#include <exception>
#include <optional>
#include <utility>

#include "storage/import/gltf_accessor.h"
#include "storage/import/message.h"

namespace raymill::storage {

namespace {

// Heap of draco while it rebuilds connectivity, per face. Sequential: faces 12, read indices 12. Edgebreaker: faces 12,
// corner table 24 and its vertices up to 12, traversal marks and stacks 8, encoding data 12, and a second corner map
// for an attribute with seams. Measured with 0.72 M faces, resident of claimed: edgebreaker 54 of 89 MB, with UV and
// normal seams 304 of 395 MB.
constexpr std::uint64_t kSequentialBytesPerFace = 24;
constexpr std::uint64_t kEdgebreakerBytesPerFace = 96;
constexpr std::uint64_t kSeamBytesPerFace = 40;
// Attributes are held twice while a prediction is undone: as decoded integers and as values; plus a 4-byte point map.
constexpr std::uint64_t kAttributeCopies = 2;
constexpr std::uint64_t kMapBytesPerPoint = 16;

struct StreamCounts {
  bool edgebreaker = false;
  std::uint64_t faces = 0;
  std::uint64_t attribute_data = 0;  ///< attributes with connectivity of their own
};

Status damaged(std::string_view what) {
  return bad_scene("the Draco stream ", what, "; the file is damaged or was cut short");
}

// A count as the given version of the format stores it: 32 bits before `since`, a varint from then on.
bool read_count(draco::DecoderBuffer& buffer, std::uint16_t version, std::uint16_t since, std::uint64_t& count) {
  std::uint32_t value = 0;
  const bool good = version < since ? buffer.Decode(&value) : draco::DecodeVarint(&value, &buffer);
  count = value;
  return good;
}

// The counts at the head of the stream (Draco bitstream 2.2, sections "Header", "Metadata" and "Connectivity").
Result<StreamCounts> read_counts(const char* data, std::size_t size_bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(data, size_bytes);
  draco::DracoHeader header;
  if (!draco::PointCloudDecoder::DecodeHeader(&buffer, &header).ok()) {
    return damaged("has no Draco header");
  }
  const auto version = static_cast<std::uint16_t>(header.version_major << 8 | header.version_minor);
  if (version > draco::kDracoMeshBitstreamVersion) {
    return Status(ErrorCode::unsupported, message("the Draco stream has version ", header.version_major, ".",
                                                  header.version_minor, ", newer than this build reads"));
  }
  if (header.encoder_type != draco::TRIANGULAR_MESH) {
    return bad_scene("the Draco stream holds a point cloud; a mesh is needed");
  }
  buffer.set_bitstream_version(version);
  if (version >= DRACO_BITSTREAM_VERSION(1, 3) && (header.flags & METADATA_FLAG_MASK) != 0) {
    draco::GeometryMetadata metadata;
    draco::MetadataDecoder decoder;
    if (!decoder.DecodeGeometryMetadata(&buffer, &metadata)) {
      return damaged("has broken metadata");
    }
  }
  StreamCounts counts;
  counts.edgebreaker = header.encoder_method == draco::MESH_EDGEBREAKER_ENCODING;
  std::uint64_t points = 0;
  if (!counts.edgebreaker) {
    return read_count(buffer, version, DRACO_BITSTREAM_VERSION(2, 2), counts.faces)
               ? Result<StreamCounts>(counts)
               : Result<StreamCounts>(damaged("ends in its connectivity"));
  }
  std::uint8_t traversal = 0;
  std::uint8_t attribute_data = 0;
  std::uint64_t new_vertices = 0;
  const bool good = buffer.Decode(&traversal) &&
                    (version >= DRACO_BITSTREAM_VERSION(2, 2) ||
                     read_count(buffer, version, DRACO_BITSTREAM_VERSION(2, 0), new_vertices)) &&
                    read_count(buffer, version, DRACO_BITSTREAM_VERSION(2, 0), points) &&
                    read_count(buffer, version, DRACO_BITSTREAM_VERSION(2, 0), counts.faces) &&
                    buffer.Decode(&attribute_data);
  if (!good) {
    return damaged("ends in its connectivity");
  }
  counts.attribute_data = attribute_data;
  return counts;
}

// A decoder of draco's that asks the ledger before the attributes are allocated.
template <typename Base>
class ClaimingDecoder final : public Base {
 public:
  explicit ClaimingDecoder(BudgetReservation& claim) : claim_(claim) {}
  Status claim_status;

 protected:
  bool DecodeAllAttributes() override {
    const draco::PointCloud& cloud = *this->point_cloud();
    std::uint64_t bytes = 0;
    for (int i = 0; i < cloud.num_attributes(); ++i) {
      const auto* attribute = cloud.attribute(i);
      // Integers of four bytes a component are what most decoders work in.
      const auto component_bytes = std::max<std::uint64_t>(4, draco::DataTypeLength(attribute->data_type()));
      const std::uint64_t stride = component_bytes * static_cast<std::uint64_t>(attribute->num_components());
      bytes += cloud.num_points() * (stride * kAttributeCopies + kMapBytesPerPoint);
    }
    claim_status = claim_.resize(claim_.bytes() + bytes);
    return claim_status.ok() && Base::DecodeAllAttributes();
  }

 private:
  BudgetReservation& claim_;
};

template <typename Base>
Status run_decoder(draco::DecoderBuffer& buffer, draco::Mesh& mesh, BudgetReservation& claim) {
  ClaimingDecoder<Base> decoder(claim);
  const draco::DecoderOptions options;
  const draco::Status status = decoder.Decode(options, &buffer, &mesh);
  RAYMILL_RETURN_IF_ERROR(decoder.claim_status);
  return status.ok() ? Status() : damaged(message("cannot be decoded (", status.error_msg_string(), ")"));
}

std::optional<ComponentType> component_type(draco::DataType type) {
  switch (type) {
    case draco::DT_INT8:
      return ComponentType::int8;
    case draco::DT_UINT8:
      return ComponentType::uint8;
    case draco::DT_INT16:
      return ComponentType::int16;
    case draco::DT_UINT16:
      return ComponentType::uint16;
    case draco::DT_UINT32:
      return ComponentType::uint32;
    case draco::DT_FLOAT32:
      return ComponentType::float32;
    default:
      return std::nullopt;
  }
}

}  // namespace

struct DracoMesh::Body {
  BudgetReservation claim;
  draco::Mesh mesh;
  const draco::PointAttribute* positions = nullptr;
  ComponentType type = ComponentType::float32;

  std::uint32_t components = 3;

  Status decode(std::span<const std::byte> stream, const DracoAttribute& attribute, Ledger& ledger);
  Status check(const DracoAttribute& attribute);
};

Status DracoMesh::Body::decode(std::span<const std::byte> stream, const DracoAttribute& attribute, Ledger& ledger) {
  const auto* data = reinterpret_cast<const char*>(stream.data());
  RAYMILL_ASSIGN_OR_RETURN(const StreamCounts counts, read_counts(data, stream.size()));
  const std::uint64_t face_bytes = counts.edgebreaker
                                       ? kEdgebreakerBytesPerFace + counts.attribute_data * kSeamBytesPerFace
                                       : kSequentialBytesPerFace;
  RAYMILL_ASSIGN_OR_RETURN(claim, ledger.claim(Tag::build, counts.faces * face_bytes));

  draco::DecoderBuffer buffer;
  buffer.Init(data, stream.size());
  RAYMILL_RETURN_IF_ERROR(counts.edgebreaker ? run_decoder<draco::MeshEdgebreakerDecoder>(buffer, mesh, claim)
                                             : run_decoder<draco::MeshSequentialDecoder>(buffer, mesh, claim));
  return check(attribute);
}

// What the accessors below rely on.
Status DracoMesh::Body::check(const DracoAttribute& attribute) {
  positions = mesh.GetAttributeByUniqueId(attribute.id);
  components = attribute.components;
  if (positions == nullptr) {
    return bad_scene("the Draco stream has no attribute ", attribute.id, ", which ",
                     components == 3 ? "POSITION" : "its material", " names");
  }
  const std::optional<ComponentType> known = component_type(positions->data_type());
  if (!known || positions->num_components() != static_cast<int>(components)) {
    return bad_scene("attribute ", attribute.id, " of the Draco stream is not made of ", components,
                     " numbers of glTF's");
  }
  type = *known;
  for (draco::FaceIndex face(0); face < mesh.num_faces(); ++face) {
    for (const draco::PointIndex& point : mesh.face(face)) {
      if (point.value() >= mesh.num_points()) {
        return bad_scene("face ", face.value(), " of the Draco stream uses point ", point.value(), " of ",
                         mesh.num_points());
      }
    }
  }
  const std::uint64_t stored_bytes = positions->buffer() == nullptr ? 0 : positions->buffer()->data_size();
  const auto stride = static_cast<std::uint64_t>(positions->byte_stride());
  if (!positions->is_mapping_identity() && positions->indices_map_size() < mesh.num_points()) {
    return bad_scene("the Draco stream maps only ", positions->indices_map_size(), " of its ", mesh.num_points(),
                     " points to positions");
  }
  for (draco::PointIndex point(0); point < mesh.num_points(); ++point) {
    const std::uint64_t start =
        positions->mapped_index(point).value() * stride + static_cast<std::uint64_t>(positions->byte_offset());
    if (positions->mapped_index(point).value() >= positions->size() ||
        start + components * size_bytes(type) > stored_bytes) {
      return bad_scene("point ", point.value(), " of the Draco stream has no position");
    }
  }
  return {};
}

DracoMesh::DracoMesh(std::unique_ptr<Body> body) : body_(std::move(body)) {}
DracoMesh::DracoMesh(DracoMesh&&) noexcept = default;
DracoMesh& DracoMesh::operator=(DracoMesh&&) noexcept = default;
DracoMesh::~DracoMesh() = default;

Result<DracoMesh> DracoMesh::decode(std::span<const std::byte> stream, const DracoAttribute& attribute,
                                    Ledger& ledger) {
  try {
    auto body = std::make_unique<Body>();
    RAYMILL_RETURN_IF_ERROR(body->decode(stream, attribute, ledger));
    return DracoMesh(std::move(body));
  } catch (const std::exception& error) {
    return damaged(message("cannot be decoded (", error.what(), ")"));
  }
}

std::uint32_t DracoMesh::point_count() const { return body_->mesh.num_points(); }
std::uint32_t DracoMesh::face_count() const { return body_->mesh.num_faces(); }

std::array<std::uint32_t, 3> DracoMesh::face(std::uint32_t face) const {
  const draco::Mesh::Face& points = body_->mesh.face(draco::FaceIndex(face));
  return {points[0].value(), points[1].value(), points[2].value()};
}

Vec3d DracoMesh::position(std::uint32_t point, bool normalized) const {
  const std::array<double, 4> p = values(point, normalized);
  return {p[0], p[1], p[2]};
}

std::array<double, 4> DracoMesh::values(std::uint32_t point, bool normalized) const {
  std::byte raw[4 * sizeof(float)];
  body_->positions->GetMappedValue(draco::PointIndex(point), raw);
  const std::uint32_t step = size_bytes(body_->type);
  std::array<double, 4> out{};
  for (std::uint32_t i = 0; i < body_->components; ++i) {
    out[i] = component_value(raw + i * step, body_->type, normalized);
  }
  return out;
}

}  // namespace raymill::storage
