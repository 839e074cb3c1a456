// GltfDocument: the structure of one glTF 2.0 file, read by tinygltf and trusted afterwards.
//
// tinygltf accepts broken files (FORMAT rules unchecked, 2^40 counts, negative indices) and refuses some good ones
// (Draco primitives, whose index accessor has no bufferView). So it never sees the file itself: the JSON is parsed,
// measured against the ledger, normalised (gltf_schema.h) and stripped of buffers, images and all that only shades;
// what is left goes through tinygltf for its typed model. Buffers stay where they are and are read by range.
// Immutable after load().
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/byte_source.h"
#include "storage/import/gltf_attribute_sources.h"
#include "storage/import/gltf_container.h"
#include "storage/import/gltf_materials.h"
#include "storage/import/gltf_meshopt.h"

namespace tinygltf {
class Model;
struct Primitive;
}  // namespace tinygltf

namespace raymill::storage {

/// A buffer as the file declares it, or, after all of these, what a compressed bufferView decodes to.
struct BufferDeclaration {
  std::string uri;  ///< empty: the BIN chunk of a GLB, or no data
  std::uint64_t size_bytes = 0;
  bool meshopt_fallback = false;            ///< stands for data that only EXT_meshopt_compression gives
  BudgetReservation uri_claim;              ///< for a data: URI, which may be megabytes
  std::optional<MeshoptView> meshopt = {};  ///< decoded from another buffer
};

class GltfDocument {
 public:
  /// Reads the JSON part of `file`. Claims for the parse and for the model.
  /// Errors: bad_scene, unsupported (a required extension, by name; another glTF version), io, budget_exceeded.
  static Result<GltfDocument> load(const ByteSource& file, const GltfContainer& container, Ledger& ledger,
                                   const MaskRule& masks = {}, AttributeSet attributes = 0);

  GltfDocument(GltfDocument&&) noexcept;
  GltfDocument& operator=(GltfDocument&&) noexcept;
  ~GltfDocument();

  [[nodiscard]] const tinygltf::Model& model() const { return *model_; }
  /// Moves the declarations out, with their claims.
  [[nodiscard]] std::vector<BufferDeclaration> take_buffers() { return std::move(buffers_); }
  /// Extensions in use that Raymill does not model: sorted, each once.
  [[nodiscard]] const std::vector<std::string>& ignored_extensions() const { return ignored_extensions_; }
  /// bufferViews that EXT_meshopt_compression compresses.
  [[nodiscard]] std::uint64_t meshopt_views() const { return meshopt_views_; }
  /// What of its materials matters by the rule that it was loaded with; nothing where that asks for nothing.
  [[nodiscard]] const GltfMaterials& materials() const { return materials_; }
  /// Which accessors hold the attributes that it was loaded with; nothing where those are none.
  [[nodiscard]] const GltfAttributeSources& attribute_sources() const { return attribute_sources_; }
  /// True where integer positions are allowed (KHR_mesh_quantization).
  [[nodiscard]] bool quantization() const { return quantization_; }

  /// The index accessor of a primitive, -1 where it has none. Use this, not Primitive::indices.
  [[nodiscard]] static int indices_of(const tinygltf::Primitive& primitive);

 private:
  GltfDocument();

  BudgetReservation claim_;
  std::unique_ptr<tinygltf::Model> model_;
  std::vector<BufferDeclaration> buffers_;
  std::vector<std::string> ignored_extensions_;
  GltfMaterials materials_;
  GltfAttributeSources attribute_sources_;
  bool quantization_ = false;
  std::uint64_t meshopt_views_ = 0;
};

}  // namespace raymill::storage
