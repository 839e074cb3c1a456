// The store file: StoreHeader | pages | metadata | page directory | StoreFooter. Normative: storage/FORMAT.md.
//
// Everything that can be known only at the end stands in the footer; the header alone says how to read the rest.
// References to pages carry the target's checksum through the directory: PageEntry is the reference.
// All integers little-endian. Plain values; immutable.
#pragma once

#include <array>
#include <cstdint>
#include <type_traits>

#include "storage/base/origin.h"
#include "storage/base/status.h"
#include "storage/pages/codec.h"

namespace raymill::storage {

constexpr std::array<char, 8> kHeaderMagic{'R', 'A', 'Y', 'M', 'I', 'L', 'L', '\x1A'};
constexpr std::array<char, 8> kFooterMagic{'\x1A', 'L', 'L', 'I', 'M', 'Y', 'A', 'R'};
constexpr std::uint32_t kFormatVersion = 1;
/// About a hundred bytes a geometry: ten million of them.
constexpr std::uint64_t kMostMetadataBytes = std::uint64_t{1} << 30;

/// What occurs in the scene; a reader refuses a store with a feature that it does not know.
enum class Feature : std::uint64_t {
  triangles = 1,     ///< always set
  geometry_ids = 2,  ///< more than one geometry: hits tell them apart
  lattice = 4,       ///< positions are multiples of the header's step
  instances = 8,     ///< objects are placed any number of times
  masks = 16,        ///< triangles are cut out by masks, or hit from their front alone
  volumes = 32,      ///< the footer names a table of volumes
  proxies = 128,     ///< pages hold what stands for subtrees that a ray does not enter
  origin = 256,      ///< positions are relative to the header's origin
  attributes = 512,  ///< the footer names pages of attributes of triangles' corners
  origins = 1024,    ///< instances have room for rays that bring more than float32 of org (widened_for_rays())
};
constexpr std::uint64_t kKnownFeatures = 15 | 16 | 32 | 128 | 256 | 512 | 1024;
constexpr bool has(std::uint64_t features, Feature feature) {
  return (features & static_cast<std::uint64_t>(feature)) != 0;
}

struct StoreHeader {
  std::array<char, 8> magic = kHeaderMagic;
  std::uint32_t format_version = kFormatVersion;
  std::uint32_t header_bytes = 64;
  std::uint64_t features = 0;
  std::uint32_t page_bytes = 0;  ///< decoded size limit
  std::uint8_t width = 0;
  std::uint8_t codec = 0;  ///< that the builder asked for; a page's own header decides
  std::uint8_t lattice = 0;
  std::uint8_t reserved = 0;
  std::int32_t lattice_step_exponent = 0;
  std::array<std::int32_t, 3> origin_steps{};  ///< with the feature origin; else 0, as the exponent
  std::int32_t origin_exponent = 0;
  std::uint32_t attributes = 0;  ///< bits of base/attribute.h; 0 without the feature
  std::uint64_t checksum = 0;    ///< of the bytes before it

  [[nodiscard]] Origin origin() const {
    return has(features, Feature::origin) ? Origin{origin_steps, origin_exponent} : Origin();
  }
};
static_assert(sizeof(StoreHeader) == 64 && std::is_trivially_copyable_v<StoreHeader>);

/// The reference to a page: where it stands and what its bytes must hash to.
struct PageEntry {
  std::uint64_t offset = 0;
  std::uint64_t checksum = 0;
  std::uint32_t encoded_bytes = 0;
  std::uint32_t decoded_bytes = 0;
};
static_assert(sizeof(PageEntry) == 24 && std::is_trivially_copyable_v<PageEntry>);

struct StoreFooter {
  std::uint64_t header_checksum = 0;  ///< of the header this footer belongs to
  std::uint64_t metadata_offset = 0;
  std::uint64_t metadata_bytes = 0;  ///< one zstd frame over JSON
  std::uint64_t metadata_plain_bytes = 0;
  std::uint64_t metadata_checksum = 0;
  std::uint64_t directory_offset = 0;
  std::uint64_t directory_checksum = 0;
  std::uint64_t page_count = 0;
  std::uint64_t triangle_count = 0;
  std::uint64_t node_count = 0;
  std::uint64_t geometry_count = 0;
  std::uint64_t decoded_bytes = 0;      ///< of all pages
  std::uint32_t max_encoded_bytes = 0;  ///< of a page
  std::uint32_t levels = 0;             ///< of the tree
  std::uint32_t root_page = 0;
  std::uint32_t root_node = 0;
  std::array<float, 3> bounds_min{};
  std::array<float, 3> bounds_max{};
  std::uint64_t file_bytes = 0;
  std::uint64_t instance_count = 0;
  std::uint32_t object_count = 0;
  std::uint32_t object_level = 0;    ///< of their roots; 0 where there are none
  std::uint32_t attribute_page = 0;  ///< the first of them, where the store has that feature; else 0
  std::uint32_t volume_page = 0;     ///< of the table of volumes, where the store has that feature; else 0
  std::uint64_t checksum = 0;        ///< of the bytes before it
  std::array<char, 8> magic = kFooterMagic;
};
static_assert(sizeof(StoreFooter) == 184 && std::is_trivially_copyable_v<StoreFooter>);

/// Sets the checksum field; tells whether it is right.
void seal(StoreHeader& header);
void seal(StoreFooter& footer);

/// Errors: corrupt (no store at all), version_mismatch, unsupported (features), checksum_mismatch.
Status check(const StoreHeader& header);
/// Checks magic, checksum, that it belongs to `header`, and that all sections lie inside `file_bytes` and meet.
Status check(const StoreFooter& footer, const StoreHeader& header, std::uint64_t file_bytes);

}  // namespace raymill::storage
