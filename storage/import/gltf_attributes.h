// GltfAttributes: the attributes of a document's triangles, handed on once for each mesh, however often it is placed.
//
//   NORMAL, TEXCOORD_n, COLOR_0, indices --> vertices --> assembler --> entries, in the order of primitive ids
//   matrix of each placement ---------------------------------------> what takes a geometry's normals to the world
//
// Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>

#include "storage/base/attribute.h"
#include "storage/base/status.h"
#include "storage/import/attribute_sink.h"
#include "storage/import/gltf_buffers.h"
#include "storage/import/gltf_document.h"
#include "storage/import/scene_import.h"
#include "storage/import/transform.h"

namespace raymill::storage {

class GltfAttributes {
 public:
  struct Config {
    const GltfDocument& document;
    GltfBuffers& buffers;
    AttributeSet set = 0;
    AttributeSink& sink;
    Ledger& ledger;
    ImportReport& report;
  };
  explicit GltfAttributes(const Config& config) : config_(config) {}

  /// The sink hears of a primitive's attributes under `geometry_id`. Errors: bad_scene (counts, types), unsupported,
  /// budget_exceeded, disk_full, io.
  Status place(int mesh, std::size_t primitive, std::uint32_t geometry_id, const Transform& world_from_mesh);

 private:
  Result<AttributeGeometry> make_entries(int mesh, std::size_t primitive);

  const Config config_;
  std::map<std::pair<int, std::size_t>, AttributeGeometry> made_;  // by mesh and primitive
};

}  // namespace raymill::storage
