// Pages of attributes, decoded: entries of triangles, or where each geometry's entries are.
//
//   AttributePageHeader | entry 0 | entry 1 | ...      the attributes of corner 0, of corner 1, of corner 2, floats
//   AttributePageHeader | AttributeGeometry 0 | ...    of geometries that follow each other
//
// Pages are full but the last of each kind, so where an entry stands is arithmetic:
//
//   attribute_page + geometry_id / geometries a page --first_entry--> entries_page + entry / entries a page
//
// Normative description: storage/ATTRIBUTES.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <type_traits>
#include <vector>

#include "storage/base/attribute.h"
#include "storage/base/status.h"

namespace raymill::storage {

enum class Codec : std::uint8_t;
struct PageRules;

constexpr std::uint16_t kPageTypeAttribute = 6;

enum class AttributePageKind : std::uint8_t { entries = 0, geometries = 1 };

struct AttributePageHeader {
  std::uint32_t magic = 0x47504D52;  // "RMPG", as all pages
  std::uint16_t page_type = kPageTypeAttribute;
  AttributePageKind kind = AttributePageKind::entries;
  std::uint8_t attributes = 0;  ///< the store's
  std::uint32_t image_bytes = 0;
  std::uint32_t triangle_nodes = 0;  ///< always: stands where a page of triangles counts its nodes, so none leads here
  std::uint32_t count = 0;           ///< of entries or geometries
  std::array<std::uint8_t, 44> reserved{};
};
static_assert(sizeof(AttributePageHeader) == 64 && std::is_trivially_copyable_v<AttributePageHeader>);

constexpr std::uint32_t attribute_item_bytes(AttributePageKind kind, AttributeSet set) {
  return kind == AttributePageKind::geometries ? std::uint32_t(sizeof(AttributeGeometry))
                                               : 3 * corner_floats(set) * std::uint32_t(sizeof(float));
}
constexpr std::uint32_t attribute_items_per_page(AttributePageKind kind, AttributeSet set, std::uint32_t page_bytes) {
  return (page_bytes - std::uint32_t(sizeof(AttributePageHeader))) / attribute_item_bytes(kind, set);
}

/// Where attributes stand in a store. Immutable.
struct AttributePlaces {
  AttributeSet set = 0;
  std::uint32_t first_page = 0;  ///< of geometries
  std::uint32_t page_count = 0;  ///< of the store
  std::uint32_t entries_page = 0;
  std::uint32_t geometries_per_page = 1;
  std::uint32_t entries_per_page = 1;

  AttributePlaces() = default;
  AttributePlaces(AttributeSet attributes, std::uint32_t attribute_page, std::uint32_t page_bytes,
                  std::uint64_t geometry_count, std::uint32_t pages);

  struct Place {
    std::uint32_t page = 0;
    std::uint32_t slot = 0;
  };
  [[nodiscard]] std::optional<Place> geometry(std::uint32_t geometry_id) const {
    return place(first_page, geometry_id, geometries_per_page);
  }
  /// Empty: beyond the store.
  [[nodiscard]] std::optional<Place> entry(std::uint64_t entry) const {
    return place(entries_page, entry, entries_per_page);
  }

 private:
  [[nodiscard]] std::optional<Place> place(std::uint64_t first, std::uint64_t item, std::uint32_t per_page) const {
    const std::uint64_t page = first + item / per_page;
    return item / per_page < page_count && page < page_count
               ? std::optional(Place{static_cast<std::uint32_t>(page), static_cast<std::uint32_t>(item % per_page)})
               : std::nullopt;
  }
};

/// Typed access to an image. Immutable view; the image must outlive it.
class AttributePageView {
 public:
  explicit AttributePageView(const std::byte* image) : image_(image) {}
  static bool is_attribute_page(const std::byte* image) {
    return reinterpret_cast<const AttributePageHeader*>(image)->page_type == kPageTypeAttribute;
  }
  [[nodiscard]] const AttributePageHeader& header() const {
    return *reinterpret_cast<const AttributePageHeader*>(image_);
  }
  /// Whether the page has such an item.
  [[nodiscard]] bool has(AttributePageKind kind, std::uint32_t slot) const {
    return header().page_type == kPageTypeAttribute && header().kind == kind && slot < header().count;
  }
  [[nodiscard]] const AttributeGeometry& geometry(std::uint32_t slot) const {
    return reinterpret_cast<const AttributeGeometry*>(image_ + sizeof(AttributePageHeader))[slot];
  }
  /// 3 * corner_floats(header().attributes).
  [[nodiscard]] const float* entry(std::uint32_t slot) const {
    return reinterpret_cast<const float*>(image_ + sizeof(AttributePageHeader)) +
           std::size_t{slot} * 3 * corner_floats(header().attributes);
  }

 private:
  const std::byte* image_;
};

/// The image of a page of items, which are as long as a multiple of attribute_item_bytes().
std::vector<std::byte> make_attribute_page(AttributePageKind kind, AttributeSet set, std::span<const std::byte> items);

/// Encodes an image. Draco has no part in it: zstd stands in.
std::vector<std::byte> encode_attribute_page(std::span<const std::byte> image, Codec codec);

/// Decodes to `frame` and checks the counts, and where geometries' entries lie. Returns the image's size. Any number is
/// a good one. Errors: corrupt.
Result<std::uint32_t> decode_attribute_page(
    std::span<const std::byte> encoded, std::span<std::byte> frame, const PageRules& rules,
    const std::function<std::optional<std::span<const std::byte>>(std::span<const std::byte> bytes, Codec codec,
                                                                  std::size_t expected)>& decompress);

/// What encoding takes: the streams twice, and a table of the corners, of at least 8 bytes each.
constexpr std::uint64_t attribute_encode_bytes(std::uint32_t page_bytes) { return 16 * std::uint64_t{page_bytes}; }
/// Scratch that decoding takes beside what decompresses: which corner each corner is a copy of.
constexpr std::uint64_t attribute_decode_bytes(std::uint32_t page_bytes) { return 2 * std::uint64_t{page_bytes}; }

}  // namespace raymill::storage
