// MaskCorners: texture coordinates and alphas of a primitive's corners, in the order of its triangles.
//
// Vertices are held (12 bytes each, claimed), indices flow through in pieces. Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/gltf_buffers.h"
#include "storage/import/gltf_document.h"
#include "storage/import/gltf_materials.h"
#include "storage/import/primitive_readers.h"

namespace raymill::storage {

struct MaskCorner {
  std::array<float, 2> at{};
  float alpha = 1;
};

class MaskCorners {
 public:
  struct Source {
    const GltfDocument& document;
    GltfBuffers& buffers;
    Ledger& ledger;
  };
  /// Errors: bad_scene, those of the buffers, budget_exceeded.
  static Result<MaskCorners> read(const Source& source, const PrimitiveMaterial& from, const MaterialMask& material,
                                  const tinygltf::Primitive& primitive);

  [[nodiscard]] bool has_tex_coords() const { return has_tex_coords_; }
  /// Whether a vertex has another alpha than 1.
  [[nodiscard]] bool has_alphas() const { return has_alphas_; }
  /// How the corners make triangles, by glTF's number.
  [[nodiscard]] int mode() const { return mode_; }
  /// Errors: those of the buffers, and of `take`.
  Status for_each_piece(const std::function<Status(std::span<const MaskCorner>)>& take);

 private:
  Status read_vertices(const Source& source, const PrimitiveMaterial& from, const MaterialMask& material,
                       const tinygltf::Primitive& primitive);
  Status read_draco(const Source& source, const PrimitiveMaterial& from, const MaterialMask& material,
                    const tinygltf::Primitive& primitive);
  Status hold(Ledger& ledger, std::uint64_t count);
  void set_tex_coords(const MaterialMask& material, std::uint64_t vertex, double u, double v);
  void set_alpha(std::uint64_t vertex, double alpha);

  BudgetReservation claim_, faces_claim_;
  std::vector<MaskCorner> vertices_;
  std::vector<std::uint32_t> faces_;  // of a Draco stream: three vertices each
  std::optional<IndexReader> indices_;
  bool has_tex_coords_ = false, has_alphas_ = false;
  int mode_ = 4;
};

}  // namespace raymill::storage
