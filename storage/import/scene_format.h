// SceneFormat: what a scene file is, by its first bytes; by its name only where they do not say. Stateless.
#pragma once

#include <cstdint>
#include <string_view>

#include "storage/base/status.h"
#include "storage/import/byte_source.h"

namespace raymill::storage {

enum class SceneFormat : std::uint8_t { gltf, ply, obj, stl_text, stl_binary };

/// "glTF" or an opening brace: glTF. "ply" and a line's end: PLY. As long as the facets that a binary STL's header
/// promises: that, also where it begins with "solid". "solid" otherwise: STL in words. Anything else is taken for what
/// its name ends with (.gltf, .glb, .obj, .ply, .stl in any case), so that the refusal speaks of that format.
/// Errors: bad_scene (neither the bytes nor the name say), io.
Result<SceneFormat> detect_format(const ByteSource& file, std::string_view name);

}  // namespace raymill::storage
