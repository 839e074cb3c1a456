// GltfContainer: where the JSON text and the binary chunk of a .gltf or .glb file lie.
//
// Told apart by the first four bytes, not by the name. A GLB's chunks are checked against its header and the file's
// size; chunks of unknown type are skipped, as glTF 2.0, 4.4 demands. Immutable.
#pragma once

#include <cstdint>
#include <optional>

#include "storage/base/status.h"
#include "storage/import/byte_source.h"

namespace raymill::storage {

/// A range of bytes of a file.
struct ByteExtent {
  std::uint64_t offset = 0;
  std::uint64_t size_bytes = 0;
};

struct GltfContainer {
  ByteExtent json;
  std::optional<ByteExtent> binary;  ///< the BIN chunk of a GLB
};

/// Errors: bad_scene, unsupported (a GLB that is not version 2), io.
Result<GltfContainer> read_container(const ByteSource& file);

}  // namespace raymill::storage
