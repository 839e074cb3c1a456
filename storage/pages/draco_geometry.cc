#include "storage/pages/draco_geometry.h"

#include <draco/compression/decode.h>
#include <draco/compression/encode.h>
#include <draco/compression/point_cloud/point_cloud_decoder.h>
#include <draco/core/varint_decoding.h>
#include <draco/mesh/mesh.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <exception>
#include <map>
#include <string>

#include "storage/base/position_map.h"
#include "storage/pages/page_streams.h"

namespace raymill::storage {
namespace {

using Lattice = std::array<std::int32_t, 3>;
using Face = std::array<Lattice, 3>;

// The six orders of three corners; the first three keep the orientation.
constexpr std::array<std::array<std::uint8_t, 3>, 6> kOrders{
    {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}}};

Lattice lattice_of(const Vec3f& p, const PositionKind& kind) {
  Lattice q;
  for (int axis = 0; axis < 3; ++axis) {
    q[axis] = static_cast<std::int32_t>(coordinate_code(p[axis], kind));
  }
  return q;
}

Vec3f position_of(const Lattice& q, const PositionKind& kind) {
  return {coordinate_value(static_cast<std::uint32_t>(q[0]), kind),
          coordinate_value(static_cast<std::uint32_t>(q[1]), kind),
          coordinate_value(static_cast<std::uint32_t>(q[2]), kind)};
}

std::vector<Face> faces_of(const PageView& view, const PositionKind& kind) {
  std::vector<Face> faces(view.header().triangle_count);
  for (std::size_t i = 0; i < faces.size(); ++i) {
    for (int corner = 0; corner < 3; ++corner) {
      faces[i][corner] = lattice_of(view.vertices()[view.indices()[i * 3 + corner]], kind);
    }
  }
  return faces;
}

std::vector<std::byte> encode_mesh(const PageView& view, const PositionKind& kind) {
  const PageHeader& header = view.header();
  draco::Mesh mesh;
  mesh.set_num_points(header.vertex_count);
  draco::GeometryAttribute attribute;
  attribute.Init(draco::GeometryAttribute::POSITION, nullptr, 3, draco::DT_INT32, false, sizeof(Lattice), 0);
  const int id = mesh.AddAttribute(attribute, true, header.vertex_count);
  for (std::uint32_t i = 0; i < header.vertex_count; ++i) {
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), lattice_of(view.vertices()[i], kind).data());
  }
  mesh.SetNumFaces(header.triangle_count);
  for (std::uint32_t i = 0; i < header.triangle_count; ++i) {
    draco::Mesh::Face face;
    for (int corner = 0; corner < 3; ++corner) {
      face[corner] = draco::PointIndex(view.indices()[std::size_t(i) * 3 + corner]);
    }
    mesh.SetFace(draco::FaceIndex(i), face);
  }
  draco::Encoder encoder;
  encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
  encoder.SetSpeedOptions(3, 3);
  draco::EncoderBuffer buffer;
  if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok()) {
    return {};
  }
  const auto* bytes = reinterpret_cast<const std::byte*>(buffer.data());
  return {bytes, bytes + buffer.size()};
}

// Whether the head of the stream (Draco bitstream 2.2, "Header" and "Connectivity") counts at most `most` faces. Draco
// allocates by these counts before it finds out that the bytes behind them are missing.
bool counts_at_most(std::span<const std::byte> bytes, std::size_t most) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::DracoHeader header;
  if (!draco::PointCloudDecoder::DecodeHeader(&buffer, &header).ok() || header.version_major != 2 ||
      header.version_minor != 2 || header.encoder_type != draco::TRIANGULAR_MESH ||
      header.encoder_method != draco::MESH_EDGEBREAKER_ENCODING) {
    return false;
  }
  std::uint8_t traversal = 0;
  std::uint32_t vertices = 0, faces = 0;
  return buffer.Decode(&traversal) && draco::DecodeVarint(&vertices, &buffer) && draco::DecodeVarint(&faces, &buffer) &&
         faces <= most && vertices <= 3 * most;
}

// The faces of a Draco mesh, or empty where the bytes are no such mesh of at most `most` faces.
std::optional<std::vector<Face>> decode_mesh(std::span<const std::byte> bytes, std::size_t most) {
  if (!counts_at_most(bytes, most)) {
    return std::nullopt;
  }
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok() || decoded.value()->num_faces() > most) {
    return std::nullopt;
  }
  const draco::Mesh& mesh = *decoded.value();
  const draco::PointAttribute* attribute = mesh.GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (attribute == nullptr || attribute->num_components() != 3 || attribute->data_type() != draco::DT_INT32) {
    return std::nullopt;
  }
  std::vector<Face> faces(mesh.num_faces());
  for (std::size_t i = 0; i < faces.size(); ++i) {
    const draco::Mesh::Face& face = mesh.face(draco::FaceIndex(static_cast<std::uint32_t>(i)));
    for (int corner = 0; corner < 3; ++corner) {
      if (face[corner].value() >= mesh.num_points() ||
          attribute->mapped_index(face[corner]).value() >= attribute->size()) {
        return std::nullopt;
      }
      attribute->GetMappedValue(face[corner], faces[i][corner].data());
    }
  }
  return faces;
}

// Draco may throw from its containers; nothing of it leaves this file.
std::optional<std::vector<Face>> decode_mesh_guarded(std::span<const std::byte> bytes, std::size_t most) {
  try {
    return decode_mesh(bytes, most);
  } catch (const std::exception&) {
    return std::nullopt;
  }
}

Face reorder(const Face& face, unsigned order) {
  return {face[kOrders[order][0]], face[kOrders[order][1]], face[kOrders[order][2]]};
}

// What is stored beside the mesh.
struct FaceMap {
  std::vector<std::uint16_t> triangle;   // of each decoded face; kLost: a face that the page does not have
  std::vector<std::uint8_t> order;       // page triangle = reorder(decoded face, order)
  std::vector<std::uint16_t> left_over;  // triangles that no decoded face gives
  static constexpr std::uint16_t kLost = 0xFFFF;
};

FaceMap match(const std::vector<Face>& page, const std::vector<Face>& decoded) {
  std::map<Face, std::vector<std::uint16_t>> by_corners;
  for (std::size_t i = page.size(); i-- > 0;) {
    Face key = page[i];
    std::sort(key.begin(), key.end());
    by_corners[key].push_back(static_cast<std::uint16_t>(i));
  }
  FaceMap map;
  for (const Face& face : decoded) {
    Face key = face;
    std::sort(key.begin(), key.end());
    const auto found = by_corners.find(key);
    if (found == by_corners.end() || found->second.empty()) {
      map.triangle.push_back(FaceMap::kLost);
      map.order.push_back(0);
      continue;
    }
    const std::uint16_t triangle = found->second.back();
    found->second.pop_back();
    unsigned order = 0;
    while (order < kOrders.size() && reorder(face, order) != page[triangle]) {
      ++order;
    }
    map.triangle.push_back(triangle);
    map.order.push_back(static_cast<std::uint8_t>(order));
  }
  for (const auto& [key, triangles] : by_corners) {
    map.left_over.insert(map.left_over.end(), triangles.begin(), triangles.end());
  }
  std::sort(map.left_over.begin(), map.left_over.end());
  return map;
}

void write_map(const FaceMap& map, const std::vector<Face>& page, std::vector<std::byte>& streams) {
  PlaneWriter out(streams);
  const std::array<std::uint32_t, 2> counts{static_cast<std::uint32_t>(map.triangle.size()),
                                            static_cast<std::uint32_t>(map.left_over.size())};
  out.put(std::span<const std::uint32_t>(counts));
  std::vector<std::uint16_t> deltas(map.triangle.size());
  std::uint16_t last = 0;
  for (std::size_t i = 0; i < deltas.size(); ++i) {
    deltas[i] = zigzag16(static_cast<std::uint16_t>(map.triangle[i] - last));
    last = map.triangle[i];
  }
  out.put(std::span<const std::uint16_t>(deltas));
  out.put(std::span<const std::uint8_t>(map.order));
  out.put(std::span<const std::uint16_t>(map.left_over));
  std::vector<std::uint32_t> corners;
  for (const std::uint16_t triangle : map.left_over) {
    for (const Lattice& corner : page[triangle]) {
      for (const std::int32_t coordinate : corner) {
        corners.push_back(static_cast<std::uint32_t>(coordinate));
      }
    }
  }
  out.put(std::span<const std::uint32_t>(corners));
}

Status corrupt_mesh(const char* what) { return {ErrorCode::corrupt, std::string("page has a Draco mesh ") + what}; }

}  // namespace

std::optional<std::vector<std::byte>> encode_draco(const PageView& view, const PositionKind& kind,
                                                   std::vector<std::byte>& streams) {
  if (view.header().triangle_count == 0) {
    return std::nullopt;
  }
  std::vector<std::byte> mesh;
  try {
    mesh = encode_mesh(view, kind);
  } catch (const std::exception&) {
    return std::nullopt;
  }
  const auto decoded = decode_mesh_guarded(mesh, view.header().triangle_count);
  if (mesh.empty() || !decoded) {
    return std::nullopt;
  }
  const std::vector<Face> page = faces_of(view, kind);
  write_map(match(page, *decoded), page, streams);
  return mesh;
}

Status decode_draco(std::span<const std::byte> mesh, PlaneReader& streams, const PositionKind& kind, std::byte* image) {
  const PageHeader& header = PageView(image).header();
  std::array<std::uint32_t, 2> counts{};
  streams.get(std::span<std::uint32_t>(counts));
  if (counts[0] > header.triangle_count || counts[1] > header.triangle_count) {
    return corrupt_mesh("with more faces than the page has triangles");
  }
  FaceMap map{std::vector<std::uint16_t>(counts[0]), std::vector<std::uint8_t>(counts[0]),
              std::vector<std::uint16_t>(counts[1])};
  streams.get(std::span(map.triangle));
  streams.get(std::span(map.order));
  streams.get(std::span(map.left_over));
  std::vector<std::uint32_t> corners(std::size_t(counts[1]) * 9);
  streams.get(std::span(corners));
  const auto decoded = decode_mesh_guarded(mesh, header.triangle_count);
  if (!decoded || decoded->size() != counts[0] || streams.failed()) {
    return corrupt_mesh("that cannot be decoded");
  }
  std::vector<Face> faces(header.triangle_count);
  std::vector<bool> known(header.triangle_count);
  std::uint16_t last = 0;
  for (std::size_t i = 0; i < decoded->size(); ++i) {
    last = static_cast<std::uint16_t>(last + unzigzag16(map.triangle[i]));
    if (last == FaceMap::kLost && header.triangle_count <= FaceMap::kLost) {
      continue;
    }
    if (last >= faces.size() || map.order[i] >= kOrders.size()) {
      return corrupt_mesh("whose map leads past the page's triangles");
    }
    faces[last] = reorder((*decoded)[i], map.order[i]);
    known[last] = true;
  }
  for (std::size_t i = 0; i < map.left_over.size(); ++i) {
    if (map.left_over[i] >= faces.size()) {
      return corrupt_mesh("whose map leads past the page's triangles");
    }
    for (int k = 0; k < 9; ++k) {
      faces[map.left_over[i]][k / 3][k % 3] = static_cast<std::int32_t>(corners[i * 9 + k]);
    }
    known[map.left_over[i]] = true;
  }
  if (std::find(known.begin(), known.end(), false) != known.end()) {
    return corrupt_mesh("that leaves triangles of the page unnamed");
  }
  PositionMap positions(std::size_t(header.vertex_count) + 1);
  auto* vertices = reinterpret_cast<Vec3f*>(image + header.vertices_offset);
  auto* indices = reinterpret_cast<std::uint16_t*>(image + header.indices_offset);
  for (std::size_t i = 0; i < faces.size() * 3; ++i) {
    const std::uint32_t index = positions.insert(position_of(faces[i / 3][i % 3], kind));
    if (index >= header.vertex_count) {
      return corrupt_mesh("with more vertices than the page");
    }
    indices[i] = static_cast<std::uint16_t>(index);
  }
  if (positions.size() != header.vertex_count) {
    return corrupt_mesh("with fewer vertices than the page");
  }
  std::memcpy(vertices, positions.positions().data(), positions.size() * sizeof(Vec3f));
  return {};
}

}  // namespace raymill::storage
