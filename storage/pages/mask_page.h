// Pages of masks, decoded: tiles of texels, and nothing else.
//
//   MaskPageHeader | tile 0 | tile 1 | ...        64 x 64 texels each, row by row, of 1, 8 or 16 bits
//
// A mask's tiles stand row by row in pages that follow each other, as many to a page as fit; so a texel's page and
// place follow from the mask's first page. Normative description: storage/MASKS.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "storage/base/mask.h"
#include "storage/base/status.h"

namespace raymill::storage {

enum class Codec : std::uint8_t;

constexpr std::uint16_t kPageTypeMask = 5;

struct MaskPageHeader {
  std::uint32_t magic = 0x47504D52;  // "RMPG", as all pages
  std::uint16_t page_type = kPageTypeMask;
  std::uint8_t bits = 1;
  std::uint8_t reserved = 0;
  std::uint32_t image_bytes = 0;
  std::uint32_t triangle_nodes = 0;  ///< always: stands where a page of triangles counts its nodes, so none leads here
  std::uint32_t tile_count = 0;
  std::array<std::uint8_t, 44> reserved_too{};
};
static_assert(sizeof(MaskPageHeader) == 64 && std::is_trivially_copyable_v<MaskPageHeader>);

/// At least 1: the smallest page takes a tile of 16 bits.
constexpr std::uint32_t tiles_per_page(std::uint32_t bits, std::uint32_t page_bytes) {
  return (page_bytes - std::uint32_t(sizeof(MaskPageHeader))) / tile_bytes(bits);
}
constexpr std::uint32_t tile_columns(std::uint32_t width) { return (width + kTileEdge - 1) / kTileEdge; }
constexpr std::uint64_t tile_count(const MaskInfo& mask) {
  return std::uint64_t(tile_columns(mask.width)) * tile_columns(mask.height);
}
constexpr std::uint64_t mask_page_count(const MaskInfo& mask, std::uint32_t page_bytes) {
  const std::uint32_t tiles = tiles_per_page(mask.bits, page_bytes);
  return (tile_count(mask) + tiles - 1) / tiles;
}

/// Where a texel's value stands.
struct TexelPlace {
  std::uint32_t page = 0;   ///< after the mask's first
  std::uint32_t texel = 0;  ///< of the page's
};
constexpr TexelPlace texel_place(const MaskInfo& mask, std::uint32_t x, std::uint32_t y, std::uint32_t page_bytes) {
  const std::uint32_t tiles = tiles_per_page(mask.bits, page_bytes);
  const std::uint32_t tile = y / kTileEdge * tile_columns(mask.width) + x / kTileEdge;
  return {tile / tiles, tile % tiles * kTileTexels + y % kTileEdge * kTileEdge + x % kTileEdge};
}

/// Typed access to an image. Immutable view; the image must outlive it.
class MaskPageView {
 public:
  explicit MaskPageView(const std::byte* image) : image_(image) {}
  static bool is_mask_page(const std::byte* image) {
    return reinterpret_cast<const MaskPageHeader*>(image)->page_type == kPageTypeMask;
  }
  [[nodiscard]] const MaskPageHeader& header() const { return *reinterpret_cast<const MaskPageHeader*>(image_); }
  /// Whether the page has this texel, of so many bits.
  [[nodiscard]] bool has(std::uint32_t texel, std::uint32_t bits) const {
    return header().page_type == kPageTypeMask && header().bits == bits && texel / kTileTexels < header().tile_count;
  }
  [[nodiscard]] std::uint32_t value(std::uint32_t texel) const {
    const std::byte* texels = image_ + sizeof(MaskPageHeader);
    switch (header().bits) {
      case 1:
        return static_cast<std::uint32_t>(texels[texel / 8] >> (texel % 8)) & 1U;
      case 8:
        return static_cast<std::uint32_t>(texels[texel]);
      default:
        return static_cast<std::uint32_t>(texels[2 * std::size_t(texel)]) |
               static_cast<std::uint32_t>(texels[2 * std::size_t(texel) + 1]) << 8;
    }
  }

 private:
  const std::byte* image_;
};

/// The image of a page of tiles, which are `bits` and as long as a multiple of tile_bytes(bits).
std::vector<std::byte> make_mask_page(std::uint32_t bits, std::span<const std::byte> tiles);

/// Encodes an image. Draco has no part in it: zstd stands in.
std::vector<std::byte> encode_mask_page(std::span<const std::byte> image, Codec codec);

/// Decodes to `frame` and checks the counts; any texel is a good one. Returns the image's size. Errors: corrupt.
Result<std::uint32_t> decode_mask_page(
    std::span<const std::byte> encoded, std::span<std::byte> frame, std::uint32_t page_bytes,
    const std::function<std::optional<std::span<const std::byte>>(std::span<const std::byte> bytes, Codec codec,
                                                                  std::size_t expected)>& decompress);

}  // namespace raymill::storage
