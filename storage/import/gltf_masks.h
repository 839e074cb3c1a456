// GltfMasks: which triangles of a document are cut out by their materials, and by what.
//
//   TEXCOORD_n, COLOR_0, indices --> corners --> assembler --> judge_face --> faces, kept by the sink once for a mesh
//   image --raymill-image--> alpha of its texels, held for as long as one primitive after the other has it
//
// Texture coordinates are mapped by KHR_texture_transform in float64 and rounded once, like positions.
// Thread-confined.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "storage/base/status.h"
#include "storage/import/alpha_reader.h"
#include "storage/import/gltf_buffers.h"
#include "storage/import/gltf_document.h"
#include "storage/import/gltf_materials.h"
#include "storage/import/scene_import.h"
#include "storage/import/transform.h"
#include "storage/import/triangle_filter.h"

namespace raymill::storage {

class GltfMasks {
 public:
  struct Config {
    const GltfDocument& document;
    const GltfMaterials& materials;
    GltfBuffers& buffers;
    std::optional<std::string> folder;  ///< where relative URIs start; none: no file beside it is read
    MaskSink& sink;
    Ledger& ledger;
    ImportReport& report;
  };
  explicit GltfMasks(const Config& config) : config_(config) {}

  /// What is known of a primitive's faces; the sink hears of it under `geometry_id`. Errors: bad_scene (no picture, no
  /// texture coordinates), unsupported, not_found, budget_exceeded, disk_full, io.
  Result<TriangleWriter::Faces> begin(int mesh, std::size_t primitive, std::uint32_t geometry_id,
                                      const Transform& world_from_mesh);

 private:
  struct Faces {
    TriangleWriter::Faces known;
    bool masked = false;  ///< some are cut out in part
  };
  using MaskKey = std::pair<int, std::pair<bool, std::size_t>>;  // image, whether texels have values, material
  using MaskLook = std::tuple<int, Wrap, Wrap, double, double>;  // image, wraps, factor, cutoff

  Result<Faces> make_faces(const PrimitiveMaterial& source, const MaterialMask& material,
                           const tinygltf::Primitive& primitive);
  /// The first of the materials that cut alike, so that they share a mask.
  std::size_t first_alike(const MaterialMask& material, std::size_t index);
  /// The material's alpha, or what stands for one that is 1 everywhere.
  Result<const AlphaMap*> alpha_of(const MaterialMask& material, std::size_t index, bool as_values);
  Result<std::optional<HeldMask>> read_image(const MaterialMask& material, const MaskInfo& like, bool as_values);

  const Config config_;
  std::map<std::pair<int, std::size_t>, Faces> made_;  // by mesh and primitive
  std::map<MaskLook, std::size_t> alike_;              // the first material that has it
  MaskKey held_key_{-1, {false, 0}};
  HeldMask held_;
  std::map<MaskKey, std::uint32_t> numbers_;  // of masks that the sink has
};

}  // namespace raymill::storage
