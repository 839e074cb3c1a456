// Geometry by Draco: edgebreaker over the integer lattice, with the map back to the page's own order.
//
// Edgebreaker reorders faces, rotates their corners and renumbers vertices; the encoder decodes its own output, finds
// for every decoded face which triangle of the page it is and how it is rotated, and stores that beside the mesh.
// Triangles that Draco lost are stored as they are. The decoder thus restores the page's indices bit for bit.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "storage/pages/codec.h"
#include "storage/pages/page_image.h"
#include "storage/pages/planes.h"

namespace raymill::storage {

/// The Draco mesh; the map is appended to `streams`. Empty when Draco cannot code this page without loss.
std::optional<std::vector<std::byte>> encode_draco(const PageView& view, const PositionKind& kind,
                                                   std::vector<std::byte>& streams);

/// Restores vertices and indices from the mesh and the map in `streams`. Errors: corrupt.
Status decode_draco(std::span<const std::byte> mesh, PlaneReader& streams, const PositionKind& kind, std::byte* image);

}  // namespace raymill::storage
