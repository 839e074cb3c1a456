// Scenes as files of other formats than glTF. Floats are written with nine digits, from which they come back bit for
// bit.
#pragma once

#include <cstdint>
#include <string>

#include "tests/support/scenes.h"

namespace raymill::tests {

enum class PlyKind : std::uint8_t { text, little_endian, big_endian };

/// One mesh; equal corners share a vertex.
std::string ply(const Mesh& mesh, PlyKind kind);
/// A group for each mesh, corners counted from the end where `negative`.
std::string obj(const Scene& scene, bool negative);
/// A solid for each mesh.
std::string stl_text(const Scene& scene);
std::string stl_binary(const Mesh& mesh);

}  // namespace raymill::tests
