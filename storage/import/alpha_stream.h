// What raymill-image writes to its stdout when it is asked for a texture's alpha, and the import reads: this head, then
// height rows of width values of value_bytes each, the top row first, little-endian.
//
//   raymill-image alpha FILE
//
// Where the picture has no alpha the head is all there is. Both ends run on one machine; it is no format to keep.
#pragma once

#include <cstdint>
#include <type_traits>

namespace raymill::storage {

constexpr std::uint64_t kAlphaStreamMagic = 0x31304148504C4152ULL;  // "RALPHA01"

struct AlphaStreamHead {
  std::uint64_t magic = kAlphaStreamMagic;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::uint32_t value_bytes = 0;  ///< 1: 0 to 255; 2: 0 to 65535; 0: no alpha
  std::uint32_t reserved = 0;
};
static_assert(sizeof(AlphaStreamHead) == 24 && std::is_trivially_copyable_v<AlphaStreamHead>);

}  // namespace raymill::storage
