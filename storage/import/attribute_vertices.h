// AttributeVertices: the attributes of a primitive's vertices, and which vertices its corners are.
//
// Vertices are held (claimed), indices flow through in pieces. Numbers are float32 as the file has them, or what its
// normalised integers stand for, rounded once. Thread-confined.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/attribute.h"
#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/gltf_attribute_sources.h"
#include "storage/import/gltf_buffers.h"
#include "storage/import/gltf_document.h"
#include "storage/import/gltf_draco.h"
#include "storage/import/primitive_readers.h"

namespace raymill::storage {

class AttributeVertices {
 public:
  struct Source {
    const GltfDocument& document;
    GltfBuffers& buffers;
    Ledger& ledger;
    AttributeSet set = 0;  ///< the store's
  };
  /// Errors: bad_scene (counts, types), unsupported, those of the buffers, budget_exceeded.
  static Result<AttributeVertices> read(const Source& source, const PrimitiveAttributes& from,
                                        const tinygltf::Primitive& primitive);

  /// Those of the set that the primitive has.
  [[nodiscard]] AttributeSet present() const { return present_; }
  /// corner_floats(set) numbers; 0 for what is not present.
  [[nodiscard]] std::span<const float> vertex(std::uint32_t number) const {
    return std::span(values_).subspan(std::size_t{number} * floats_, floats_);
  }
  /// Vertices that have a number which is not finite.
  [[nodiscard]] std::uint64_t not_finite() const;
  /// How the corners make triangles, by glTF's number.
  [[nodiscard]] int mode() const { return mode_; }
  /// Calls take(vertices) for the corners in their order. Errors: those of the buffers, and of `take`.
  Status for_each_piece(const std::function<Status(std::span<const std::uint32_t>)>& take);

 private:
  Status read_vertices(const Source& source, const PrimitiveAttributes& from, const tinygltf::Primitive& primitive);
  Status read_accessor(const Source& source, Attribute attribute, int index);
  Status read_draco(const Source& source, const PrimitiveAttributes& from, const tinygltf::Primitive& primitive);
  Status take_faces(const DracoMesh& mesh, Ledger& ledger);
  Status hold(Ledger& ledger, std::uint64_t count);
  /// Where an attribute's numbers of a vertex stand.
  float* place(Attribute attribute, std::uint64_t vertex) {
    return values_.data() + vertex * floats_ + first_float(set_, attribute);
  }

  AttributeSet set_ = 0, present_ = 0;
  std::uint32_t floats_ = 0;  // of a vertex
  std::uint64_t count_ = 0;
  BudgetReservation claim_, faces_claim_;
  std::vector<float> values_;
  std::vector<std::uint32_t> faces_;  // of a Draco stream: three vertices each
  bool has_faces_ = false;
  std::optional<IndexReader> indices_;
  int mode_ = 4;
};

}  // namespace raymill::storage
