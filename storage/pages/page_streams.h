// Streams: an image as delta-coded values in byte planes, before the entropy coder.
//
//   nodes | external references | vertices | indices | primitive ids | geometries | geometry indices
//
// Vertices stand in the order of first use, so an index is mostly "the next new one" and a position is near the one
// before it. Positions are exact: float bits mapped to ordered integers, or integers of the lattice.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "storage/pages/codec.h"
#include "storage/pages/page_image.h"
#include "storage/pages/planes.h"

namespace raymill::storage {

/// The position's coordinate as an integer of the given kind, and back; exact for every coordinate of a store.
std::uint32_t coordinate_code(float value, const PositionKind& kind);
float coordinate_value(std::uint32_t code, const PositionKind& kind);

/// Everything but vertices and indices.
void write_structure(const PageView& view, std::vector<std::byte>& out);
void read_structure(PlaneReader& in, std::byte* image);

/// Vertices and indices.
void write_geometry(const PageView& view, const PositionKind& kind, std::vector<std::byte>& out);
void read_geometry(PlaneReader& in, const PositionKind& kind, std::byte* image);

}  // namespace raymill::storage
