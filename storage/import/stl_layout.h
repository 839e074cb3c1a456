// The binary STL: 80 bytes of anything, the number of facets (little-endian, 32 bits), and 50 bytes for each: normal
// and three corners in float32, two bytes that mean nothing. Stateless.
#pragma once

#include <cstdint>

#include "storage/base/status.h"
#include "storage/import/byte_source.h"

namespace raymill::storage {

constexpr std::uint64_t kStlHeaderBytes = 84;
constexpr std::uint64_t kStlFacetBytes = 50;

/// Facets that the header promises. Errors: bad_scene (not as many bytes follow), io.
Result<std::uint64_t> stl_facets(const ByteSource& file);

}  // namespace raymill::storage
