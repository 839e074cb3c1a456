#include "storage/import/gltf_masks.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <vector>

#include "storage/import/data_uri.h"
#include "storage/import/mask_corners.h"
#include "storage/import/mask_footprint.h"
#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"
#include "storage/import/triangle_assembler.h"

namespace raymill::storage {

namespace {

constexpr const char* kOpaqueRemedy = "; mend it, or build with --ignore-alpha to take everything as opaque";

bool is_usable(const FaceMask& face) {
  return std::all_of(face.corners.begin(), face.corners.end(), [](const auto& corner) {
    return std::fabs(corner[0]) <= kMostTexCoord && std::fabs(corner[1]) <= kMostTexCoord;
  });
}

// Triangles of corners become faces.
class FaceWriter {
 public:
  FaceWriter(const AlphaMap& map, std::optional<std::uint32_t> number, MaskSink& sink, ImportReport& report)
      : map_(map), number_(number), sink_(sink), report_(report) {}

  Status add(const std::array<MaskCorner, 3>& corners) {
    FaceMask face;
    for (std::size_t i = 0; i < 3; ++i) {
      face.corners[i] = corners[i].at;
      face.alphas[i] = corners[i].alpha;
    }
    if (is_usable(face)) {
      judge_face(map_, 0, face);
    } else {
      ++report_.counts[ImportCode::opaque_without_texcoords];
    }
    if (face.mask < FaceMask::kCut) {
      if (!number_) {
        RAYMILL_ASSIGN_OR_RETURN(number_, sink_.add_mask(map_));
      }
      face.mask = *number_;
      masked = true;
    } else {
      const std::uint32_t verdict = face.mask;
      face = {};
      face.mask = verdict;
    }
    piece_.push_back(face);
    return piece_.size() == kPiece ? flush() : Status();
  }

  Status flush() {
    RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t at, sink_.add_faces(piece_));
    first = first == GeometryMask::kNoFaces ? at : first;
    count += piece_.size();
    piece_.clear();
    return {};
  }

  [[nodiscard]] std::optional<std::uint32_t> number() const { return number_; }
  std::uint64_t first = GeometryMask::kNoFaces, count = 0;
  bool masked = false;

 private:
  static constexpr std::size_t kPiece = 1024;
  const AlphaMap& map_;
  std::optional<std::uint32_t> number_;
  MaskSink& sink_;
  ImportReport& report_;
  std::vector<FaceMask> piece_;
};

// One opaque texel, for vertices that have alphas where the texture has none.
AlphaMap solid(const MaskInfo& like) {
  AlphaMap map;
  map.info = like;
  map.info.bits = 8;
  map.row_bytes = AlphaMap::bytes_of_row(1, 8);
  map.texels.assign(map.row_bytes, std::byte{255});
  return map;
}

}  // namespace

Result<TriangleWriter::Faces> GltfMasks::begin(int mesh, std::size_t primitive, std::uint32_t geometry_id,
                                               const Transform& world_from_mesh) {
  const PrimitiveMaterial* source = config_.materials.find(mesh, primitive);
  const tinygltf::Model& model = config_.document.model();
  const tinygltf::Primitive& shape = model.meshes[static_cast<std::size_t>(mesh)].primitives[primitive];
  if (source == nullptr || shape.mode < TINYGLTF_MODE_TRIANGLES || !shape.attributes.contains("POSITION")) {
    return TriangleWriter::Faces();
  }
  const MaterialMask& material = config_.materials.materials[static_cast<std::size_t>(source->material)];
  auto made = made_.find({mesh, primitive});
  if (made == made_.end()) {
    Faces faces;
    if (material.masked) {
      RAYMILL_ASSIGN_OR_RETURN(faces, make_faces(*source, material, shape));
    }
    made = made_.emplace(std::pair(mesh, primitive), faces).first;
  }
  GeometryMask masks;
  masks.first_face = made->second.masked ? made->second.known.first : GeometryMask::kNoFaces;
  if (material.one_side) {
    masks.sides = determinant(placement_of(world_from_mesh)) < 0 ? Sides::clockwise : Sides::counterclockwise;
  }
  if (made->second.masked || masks.sides != Sides::both) {
    config_.sink.set_masks(geometry_id, masks);
  }
  return made->second.known;
}

Result<GltfMasks::Faces> GltfMasks::make_faces(const PrimitiveMaterial& source, const MaterialMask& material,
                                               const tinygltf::Primitive& primitive) {
  Faces faces;
  const std::size_t index = first_alike(material, static_cast<std::size_t>(source.material));
  RAYMILL_ASSIGN_OR_RETURN(MaskCorners corners, MaskCorners::read({config_.document, config_.buffers, config_.ledger},
                                                                  source, material, primitive));
  const bool as_values = corners.has_alphas();
  RAYMILL_ASSIGN_OR_RETURN(const AlphaMap* map, alpha_of(material, index, as_values));
  if (map == nullptr && !as_values) {
    // One alpha for all.
    faces.known.all_cut = !counts(1, 1, material.factor, 1, material.cutoff);
    return faces;
  }
  const AlphaMap plain = solid({1, 1, 8, material.wrap_s, material.wrap_t, 0, 0, material.factor, material.cutoff});
  if (map != nullptr && !corners.has_tex_coords()) {
    return bad_scene(material.name, " needs TEXCOORD_", material.tex_coord, ", which this primitive has not",
                     kOpaqueRemedy);
  }
  const MaskKey key{map == nullptr ? -1 : material.image, {as_values, index}};
  const auto known = numbers_.find(key);
  FaceWriter writer(map == nullptr ? plain : *map,
                    known == numbers_.end() ? std::nullopt : std::optional(known->second), config_.sink,
                    config_.report);
  CornerAssembler<MaskCorner, FaceWriter> assembler(static_cast<PrimitiveMode>(corners.mode()), writer);
  RAYMILL_RETURN_IF_ERROR(
      corners.for_each_piece([&](std::span<const MaskCorner> piece) { return assembler.feed(piece); }));
  RAYMILL_RETURN_IF_ERROR(writer.flush());
  if (writer.number()) {
    numbers_[key] = *writer.number();
  }
  faces.known = {&config_.sink, writer.first, writer.count, false};
  faces.masked = writer.masked;
  return faces;
}

std::size_t GltfMasks::first_alike(const MaterialMask& material, std::size_t index) {
  const MaskLook look{material.image, material.wrap_s, material.wrap_t, material.factor, material.cutoff};
  return alike_.try_emplace(look, index).first->second;
}

Result<const AlphaMap*> GltfMasks::alpha_of(const MaterialMask& material, std::size_t index, bool as_values) {
  const AlphaMap* none = nullptr;
  if (material.image < 0) {
    return none;
  }
  const MaskKey key{material.image, {as_values, index}};
  if (held_key_ != key) {
    held_ = {};
    held_key_ = {-1, {false, 0}};
    const MaskInfo like{1, 1, 1, material.wrap_s, material.wrap_t, 0, 0, material.factor, material.cutoff};
    Result<std::optional<HeldMask>> read = read_image(material, like, as_values);
    if (!read.ok()) {
      const bool of_scene =
          read.status().code() == ErrorCode::bad_scene || read.status().code() == ErrorCode::unsupported;
      const Status status(read.status().code(),
                          message(material.name, ": ", read.status().message(), of_scene ? kOpaqueRemedy : ""));
      return status;
    }
    if (*read) {
      held_ = std::move(**read);
    }
    held_key_ = key;
  }
  return held_.map.texels.empty() ? none : static_cast<const AlphaMap*>(&held_.map);
}

Result<std::optional<HeldMask>> GltfMasks::read_image(const MaterialMask& material, const MaskInfo& like,
                                                      bool as_values) {
  const ImageSource& source = config_.materials.images[static_cast<std::size_t>(material.image)];
  const auto in_image = [&](const Status& status) { return in_context(material.image_name, status); };
  if (!source.uri.empty() && !is_data_uri(source.uri)) {
    const std::optional<std::string> name = percent_decode(source.uri);
    if (!config_.folder || !name || name->find('\0') != std::string::npos || name->starts_with('/') ||
        name->find("://") != std::string::npos) {
      return Status(ErrorCode::unsupported,
                    message(material.image_name, " has a uri that is no file name in the scene's folder"));
    }
    Result<std::optional<HeldMask>> read = read_alpha(*config_.folder + *name, like, as_values, config_.ledger);
    return read.ok() ? std::move(read) : in_context(message(material.image_name, " (", *name, ")"), read.status());
  }
  std::vector<std::byte> bytes;
  BudgetReservation claim;
  if (!source.uri.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(claim, config_.ledger.claim(Tag::build, 2 * data_uri_bytes_max(source.uri)));
    std::optional<std::vector<std::byte>> decoded = decode_data_uri(source.uri);
    if (!decoded) {
      return in_image(bad_scene("has a data: URI that is not base64"));
    }
    bytes = std::move(*decoded);
  } else {
    const tinygltf::Model& model = config_.document.model();
    RAYMILL_ASSIGN_OR_RETURN(const ByteExtent extent, view_extent(model, source.buffer_view, config_.buffers));
    RAYMILL_ASSIGN_OR_RETURN(claim, config_.ledger.claim(Tag::build, 2 * extent.size_bytes));
    bytes.resize(extent.size_bytes);
    const int buffer = model.bufferViews[static_cast<std::size_t>(source.buffer_view)].buffer;
    RAYMILL_RETURN_IF_ERROR(config_.buffers.read(buffer, extent.offset, bytes));
  }
  RAYMILL_ASSIGN_OR_RETURN(PictureFile file, PictureFile::create(bytes.size()));
  RAYMILL_RETURN_IF_ERROR(file.write(bytes));
  Result<std::optional<HeldMask>> read = read_alpha(file.path(), like, as_values, config_.ledger);
  return read.ok() ? std::move(read) : in_image(read.status());
}

}  // namespace raymill::storage
