// GltfMaterials: what of a document's materials cuts triangles out or takes one of their sides.
//
// Read from the JSON before it is normalised (gltf_schema.h), and only where masks or sides are asked for: a document
// whose shading is broken is imported all the same where nobody looks at it. Nothing is trusted; what does not matter
// to alpha is not looked at. Immutable.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mask.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

/// A material that cuts something out or has one side.
struct MaterialMask {
  std::string name;  ///< "materials[3] 'frond'", for sentences
  bool masked = false;
  bool one_side = false;
  double cutoff = 0.5;
  double factor = 1;       ///< of alpha, clamped to 0..1
  int image = -1;          ///< of its colour; -1: none
  std::string image_name;  ///< "images[2]", or with its file
  std::uint32_t tex_coord = 0;
  Wrap wrap_s = Wrap::repeat, wrap_t = Wrap::repeat;
  /// Rows of the map of texture coordinates: u' = m[0] u + m[1] v + m[2].
  std::array<double, 6> transform{1, 0, 0, 0, 1, 0};
};

struct ImageSource {
  std::string uri;  ///< empty: in a bufferView
  int buffer_view = -1;
};

/// What a primitive brings for its material.
struct PrimitiveMaterial {
  int material = -1;                             ///< in `materials`; -1: opaque, and with two sides
  int tex_coords = -1;                           ///< accessor; -1: none
  int colors = -1;                               ///< accessor of COLOR_0
  int draco_tex_coords = -1, draco_colors = -1;  ///< attributes of a Draco stream
};

struct GltfMaterials {
  BudgetReservation claim;
  std::vector<MaterialMask> materials;
  std::vector<ImageSource> images;                         ///< [image]; filled for those that materials name
  std::vector<std::vector<PrimitiveMaterial>> primitives;  ///< [mesh][primitive]

  [[nodiscard]] const PrimitiveMaterial* find(int mesh, std::size_t primitive) const;
};

/// Errors: bad_scene (a material that is asked for and names what is not there), unsupported, budget_exceeded.
Result<GltfMaterials> read_materials(const nlohmann::json& root, const MaskRule& rule, Ledger& ledger);

}  // namespace raymill::storage
