// GltfMeshopt: EXT_meshopt_compression by meshoptimizer, behind checks of our own.
//
// Debian's library asserts what it expects of counts and strides, so these are checked before; its decoders are safe
// on any stream, and what they give is judged like any other buffer's bytes. Stateless.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <span>

#include "storage/base/status.h"

namespace raymill::storage {

enum class MeshoptMode : std::uint8_t { attributes, triangles, indices };
enum class MeshoptFilter : std::uint8_t { none, octahedral, quaternion, exponential };

/// A compressed bufferView: where its stream lies, and what comes out of it.
struct MeshoptView {
  int buffer = 0;
  std::uint64_t offset = 0;
  std::uint64_t size_bytes = 0;  ///< of the stream
  std::uint64_t count = 0;       ///< elements that come out
  std::uint32_t stride_bytes = 0;
  MeshoptMode mode = MeshoptMode::attributes;
  MeshoptFilter filter = MeshoptFilter::none;

  [[nodiscard]] std::uint64_t decoded_bytes() const { return count * stride_bytes; }
};

/// Reads the extension's object, whose fields the schema has checked. Errors: bad_scene (a mode, filter, stride or
/// count that the extension forbids).
Result<MeshoptView> parse_meshopt(const nlohmann::json& extension);

/// Decodes `stream` into `out`, which has decoded_bytes(). Errors: bad_scene.
Status decode_meshopt(const MeshoptView& view, std::span<const std::byte> stream, std::span<std::byte> out);

}  // namespace raymill::storage
