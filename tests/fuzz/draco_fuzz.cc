// A Draco stream of any bytes: decoded into faces and positions that can be read, or refused, within a small budget.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "storage/import/gltf_draco.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using raymill::storage::DracoMesh;
  raymill::storage::Ledger ledger(raymill::mebibytes(64));
  const raymill::Result<DracoMesh> mesh = DracoMesh::decode(std::as_bytes(std::span(data, size)), 0, ledger);
  if (!mesh.ok()) {
    return 0;
  }
  for (std::uint32_t face = 0; face < mesh->face_count(); ++face) {
    for (const std::uint32_t point : mesh->face(face)) {
      if (point >= mesh->point_count()) {
        std::abort();
      }
      (void)mesh->position(point, true);
    }
  }
  return 0;
}
