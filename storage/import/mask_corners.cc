#include "storage/import/mask_corners.h"

#include <algorithm>
#include <cmath>

#include "storage/import/accessor_elements.h"
#include "storage/import/gltf_accessor.h"
#include "storage/import/gltf_draco.h"
#include "storage/import/message.h"
#include "storage/import/release.h"
#include "storage/import/tinygltf_config.h"

namespace raymill::storage {

namespace {

constexpr const char* kDracoExtension = "KHR_draco_mesh_compression";

Status other_count(int accessor, std::uint64_t count, std::uint64_t vertices) {
  return bad_scene("accessors[", accessor, "] has ", count, " elements for ", vertices, " vertices");
}

bool has_alpha(const tinygltf::Model& model, int accessor) {
  return accessor >= 0 && model.accessors[static_cast<std::size_t>(accessor)].type == TINYGLTF_TYPE_VEC4;
}

}  // namespace

Result<MaskCorners> MaskCorners::read(const Source& source, const PrimitiveMaterial& from, const MaterialMask& material,
                                      const tinygltf::Primitive& primitive) {
  MaskCorners corners;
  corners.mode_ = primitive.mode;
  RAYMILL_RETURN_IF_ERROR(primitive.extensions.contains(kDracoExtension)
                              ? corners.read_draco(source, from, material, primitive)
                              : corners.read_vertices(source, from, material, primitive));
  return corners;
}

Status MaskCorners::hold(Ledger& ledger, std::uint64_t count) {
  Result<BudgetReservation> claim =
      ledger.claim(Tag::build, count * sizeof(MaskCorner) + kPieceCorners * 2 * (sizeof(MaskCorner) + 16));
  if (!claim.ok()) {
    return in_context(message("texture coordinates of its ", count, " vertices must be held in memory"),
                      claim.status());
  }
  claim_ = std::move(*claim);
  vertices_.resize(count);
  return {};
}

void MaskCorners::set_tex_coords(const MaterialMask& material, std::uint64_t vertex, double u, double v) {
  const auto& m = material.transform;
  vertices_[vertex].at = {static_cast<float>(m[0] * u + m[1] * v + m[2]),
                          static_cast<float>(m[3] * u + m[4] * v + m[5])};
}

// What is no number counts as opaque.
void MaskCorners::set_alpha(std::uint64_t vertex, double alpha) {
  const double known = std::isnan(alpha) ? 1 : std::clamp(alpha, 0.0, 1.0);
  vertices_[vertex].alpha = static_cast<float>(known);
  has_alphas_ = has_alphas_ || vertices_[vertex].alpha != 1;
}

Status MaskCorners::read_vertices(const Source& source, const PrimitiveMaterial& from, const MaterialMask& material,
                                  const tinygltf::Primitive& primitive) {
  const tinygltf::Model& model = source.document.model();
  const auto position = static_cast<std::size_t>(primitive.attributes.at("POSITION"));
  const std::uint64_t count = model.accessors[position].count;
  RAYMILL_RETURN_IF_ERROR(hold(source.ledger, count));
  if (from.tex_coords >= 0) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor,
                             GltfAccessor::open(model, from.tex_coords, 2, source.buffers, source.ledger));
    if (accessor.count() != count) {
      return other_count(from.tex_coords, accessor.count(), count);
    }
    has_tex_coords_ = true;
    RAYMILL_RETURN_IF_ERROR(for_each_element<2>(
        std::move(accessor), [&](std::uint64_t i, const auto& uv) { set_tex_coords(material, i, uv[0], uv[1]); }));
  }
  if (has_alpha(model, from.colors)) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor,
                             GltfAccessor::open(model, from.colors, 4, source.buffers, source.ledger));
    if (accessor.count() != count) {
      return other_count(from.colors, accessor.count(), count);
    }
    RAYMILL_RETURN_IF_ERROR(
        for_each_element<4>(std::move(accessor), [&](std::uint64_t i, const auto& rgba) { set_alpha(i, rgba[3]); }));
  }
  if (const int index = GltfDocument::indices_of(primitive); index >= 0) {
    RAYMILL_ASSIGN_OR_RETURN(GltfAccessor accessor, GltfAccessor::open(model, index, 1, source.buffers, source.ledger));
    RAYMILL_ASSIGN_OR_RETURN(IndexReader reader, IndexReader::open(std::move(accessor), count));
    indices_.emplace(std::move(reader));
  }
  return {};
}

Status MaskCorners::read_draco(const Source& source, const PrimitiveMaterial& from, const MaterialMask& material,
                               const tinygltf::Primitive& primitive) {
  mode_ = TINYGLTF_MODE_TRIANGLES;
  const tinygltf::Model& model = source.document.model();
  const int view = primitive.extensions.at(kDracoExtension).Get("bufferView").GetNumberAsInt();
  RAYMILL_ASSIGN_OR_RETURN(const ByteExtent extent, view_extent(model, view, source.buffers));
  RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation stream_claim, source.ledger.claim(Tag::build, extent.size_bytes));
  std::vector<std::byte> stream(extent.size_bytes);
  RAYMILL_RETURN_IF_ERROR(
      source.buffers.read(model.bufferViews[static_cast<std::size_t>(view)].buffer, extent.offset, stream));
  const auto normalized = [&](int accessor) {
    return accessor >= 0 && model.accessors[static_cast<std::size_t>(accessor)].normalized;
  };
  const auto decode = [&](int attribute, std::uint32_t components) {
    Result<DracoMesh> mesh =
        DracoMesh::decode(stream, {static_cast<std::uint32_t>(attribute), components}, source.ledger);
    return mesh.ok() ? std::move(mesh) : in_context(message("bufferViews[", view, "]"), mesh.status());
  };
  const auto begin = [&](const DracoMesh& mesh) -> Status {
    if (!vertices_.empty()) {
      return {};
    }
    RAYMILL_RETURN_IF_ERROR(hold(source.ledger, mesh.point_count()));
    RAYMILL_ASSIGN_OR_RETURN(
        faces_claim_, source.ledger.claim(Tag::build, 3 * sizeof(std::uint32_t) * std::uint64_t{mesh.face_count()}));
    for (std::uint32_t face = 0; face < mesh.face_count(); ++face) {
      const auto points = mesh.face(face);
      faces_.insert(faces_.end(), points.begin(), points.end());
    }
    return {};
  };
  if (from.draco_tex_coords >= 0) {
    RAYMILL_ASSIGN_OR_RETURN(const DracoMesh mesh, decode(from.draco_tex_coords, 2));
    RAYMILL_RETURN_IF_ERROR(begin(mesh));
    has_tex_coords_ = true;
    for (std::uint32_t i = 0; i < mesh.point_count(); ++i) {
      const std::array<double, 4> uv = mesh.values(i, normalized(from.tex_coords));
      set_tex_coords(material, i, uv[0], uv[1]);
    }
  }
  if (from.draco_colors >= 0 && has_alpha(model, from.colors)) {
    RAYMILL_ASSIGN_OR_RETURN(const DracoMesh mesh, decode(from.draco_colors, 4));
    RAYMILL_RETURN_IF_ERROR(begin(mesh));
    for (std::uint32_t i = 0; i < mesh.point_count(); ++i) {
      set_alpha(i, mesh.values(i, normalized(from.colors))[3]);
    }
  }
  return {};
}

Status MaskCorners::for_each_piece(const std::function<Status(std::span<const MaskCorner>)>& take) {
  std::vector<MaskCorner> piece(kPieceCorners);
  std::vector<std::uint32_t> numbers(kPieceCorners);
  const bool indexed = indices_.has_value();
  const std::uint64_t count = indexed          ? indices_->accessor().count()
                              : faces_.empty() ? vertices_.size()
                                               : faces_.size();
  for (std::uint64_t first = 0; first < count; first += kPieceCorners) {
    const std::size_t taken = std::min<std::uint64_t>(kPieceCorners, count - first);
    if (indexed) {
      RAYMILL_RETURN_IF_ERROR(indices_->read(first, std::span(numbers).first(taken)));
    }
    for (std::size_t i = 0; i < taken; ++i) {
      piece[i] = vertices_[indexed ? numbers[i] : faces_.empty() ? first + i : faces_[first + i]];
    }
    RAYMILL_RETURN_IF_ERROR(take(std::span(piece).first(taken)));
  }
  return {};
}

}  // namespace raymill::storage
