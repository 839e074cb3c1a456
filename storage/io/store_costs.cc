#include "storage/io/store_costs.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "storage/base/aligned.h"
#include "storage/io/store_file.h"
#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"
#include "storage/pages/mask_page.h"
#include "storage/pages/masked_section.h"
#include "storage/pages/proxy.h"
#include "storage/volume/volume_page.h"

namespace raymill {
namespace {

using namespace storage;

constexpr std::uint64_t kLookBudgetBytes = gibibytes(4);
// Blocks that hold a page's head, wherever in the first one it begins.
constexpr std::uint64_t kHeadBytes = 2 * kDirectBlockBytes;
static_assert(sizeof(EncodedHeader) + sizeof(MaskSection) <= kDirectBlockBytes);

using HeadBuffer = std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>>;

// What pages hold, summed.
struct Sums {
  std::uint64_t triangle_pages = 0, triangle_store = 0, triangle_decoded = 0;
  std::uint64_t volume_pages = 0, volume_store = 0, volume_decoded = 0;
  std::uint64_t mask_pages = 0, mask_store = 0, mask_decoded = 0;
  std::uint64_t attribute_pages = 0, attribute_store = 0, attribute_decoded = 0;
  std::uint64_t geometry_bytes = 0, instance_bytes = 0, section_bytes = 0, proxy_bytes = 0;
};

bool is_known(const EncodedHeader& head) {
  const bool has_triangles =
      head.page_type == kPageTypeTriangles || head.page_type == kPageTypeMasked || head.page_type == kPageTypeProxies;
  return head.page_type == kPageTypeVolume || head.page_type == kPageTypeMask || head.page_type == kPageTypeAttribute ||
         (has_triangles && head.geometry_index_bytes <= 2);
}

// The section of a masked page without the gaps between its arrays.
std::uint64_t section_bytes(const EncodedHeader& head, const MaskSection& section) {
  return sizeof section + std::uint64_t(head.triangle_count) * sizeof(std::uint16_t) +
         std::uint64_t(section.entry_count) * sizeof(MaskedTriangle) +
         std::uint64_t(section.mask_count) * sizeof(MaskRef) +
         std::uint64_t(section.alpha_count) * sizeof(CornerAlphas);
}

// A page's head, and where it has masks the head of their section.
struct Heads {
  EncodedHeader page;
  MaskSection masks;
};

Result<Heads> read_heads(const StoreFile& store, PageId page, HeadBuffer& buffer) {
  PageBlocks blocks = store.blocks_of(page);
  blocks.bytes = std::min(blocks.bytes, kHeadBytes);
  Heads heads;
  const std::uint64_t there = store.read_blocks(blocks, buffer);
  if (there < blocks.skipped + sizeof heads.page) {
    return store.page_fault(page, {ErrorCode::io, "cannot be read; the file may be cut short, or the disk be failing"});
  }
  const std::byte* at = buffer.data() + blocks.skipped;
  std::memcpy(&heads.page, at, sizeof heads.page);
  if (!is_known(heads.page)) {
    return store.page_fault(page, {ErrorCode::corrupt, "begins with no page's head; build the store again"});
  }
  if (heads.page.page_type == kPageTypeMasked && there >= blocks.skipped + sizeof heads.page + sizeof heads.masks) {
    std::memcpy(&heads.masks, at + sizeof heads.page, sizeof heads.masks);
  }
  return heads;
}

Status add_page(const StoreFile& store, PageId page, HeadBuffer& buffer, Sums& sums) {
  const PageEntry& entry = store.entry(page);
  RAYMILL_ASSIGN_OR_RETURN(const Heads heads, read_heads(store, page, buffer));
  const EncodedHeader& head = heads.page;
  if (head.page_type == kPageTypeMask) {
    ++sums.mask_pages;
    sums.mask_store += entry.encoded_bytes;
    sums.mask_decoded += entry.decoded_bytes;
    return {};
  }
  if (head.page_type == kPageTypeVolume) {
    ++sums.volume_pages;
    sums.volume_store += entry.encoded_bytes;
    sums.volume_decoded += entry.decoded_bytes;
    return {};
  }
  if (head.page_type == kPageTypeAttribute) {
    ++sums.attribute_pages;
    sums.attribute_store += entry.encoded_bytes;
    sums.attribute_decoded += entry.decoded_bytes;
    return {};
  }
  const std::uint64_t geometries = std::uint64_t(head.geometry_count) * sizeof(std::uint32_t) +
                                   std::uint64_t(head.triangle_count) * head.geometry_index_bytes;
  const std::uint64_t instances = std::uint64_t(head.instance_count) * sizeof(Instance);
  const std::uint64_t section = head.page_type == kPageTypeMasked ? section_bytes(head, heads.masks) : 0;
  const std::uint64_t proxies =
      head.page_type == kPageTypeProxies ? std::uint64_t(head.external_count) * sizeof(Proxy) : 0;
  if (geometries + instances + section + proxies > entry.decoded_bytes) {
    return store.page_fault(page, {ErrorCode::corrupt, "has a head that asks for more than the page; build it again"});
  }
  ++sums.triangle_pages;
  sums.triangle_store += entry.encoded_bytes;
  sums.triangle_decoded += entry.decoded_bytes - geometries - instances - section - proxies;
  sums.geometry_bytes += geometries;
  sums.instance_bytes += instances;
  sums.section_bytes += section;
  sums.proxy_bytes += proxies;
  return {};
}

}  // namespace

Result<std::vector<FeatureCost>> store_costs(const std::string& path) {
  Ledger ledger(kLookBudgetBytes);
  RAYMILL_ASSIGN_OR_RETURN(const std::shared_ptr<const StoreFile> store, StoreFile::open(path, ledger));
  HeadBuffer buffer(kHeadBytes);
  Sums sums;
  for (std::uint32_t i = 0; i < store->page_count(); ++i) {
    RAYMILL_RETURN_IF_ERROR(add_page(*store, PageId{i}, buffer, sums));
  }
  std::vector<FeatureCost> costs;
  const auto has = [&](Feature feature) {
    return (store->header().features & static_cast<std::uint64_t>(feature)) != 0;
  };
  if (!has(Feature::geometry_ids)) {
    sums.triangle_decoded += std::exchange(sums.geometry_bytes, 0);  // the one id that every page names
  }
  const auto add = [&](Feature feature, const FeatureCost& cost) {
    if (has(feature)) {
      costs.push_back(cost);
    }
  };
  add(Feature::triangles, {"triangles", sums.triangle_pages, sums.triangle_store, sums.triangle_decoded});
  add(Feature::geometry_ids, {"geometry_ids", 0, {}, sums.geometry_bytes});
  // Corners on the lattice stand in memory like others.
  add(Feature::lattice, {"lattice", 0, {}, 0});
  add(Feature::instances, {"instances", 0, {}, sums.instance_bytes});
  add(Feature::masks, {"masks", sums.mask_pages, sums.mask_store, sums.mask_decoded + sums.section_bytes});
  add(Feature::volumes, {"volumes", sums.volume_pages, sums.volume_store, sums.volume_decoded});
  add(Feature::proxies, {"proxies", 0, {}, sums.proxy_bytes});
  // A point of the header.
  add(Feature::origin, {"origin", 0, {}, 0});
  add(Feature::origins, {"origins", 0, {}, 0});
  add(Feature::attributes, {"attributes", sums.attribute_pages, sums.attribute_store, sums.attribute_decoded});
  costs.push_back(
      {"file", 0,
       store->footer().file_bytes - sums.triangle_store - sums.mask_store - sums.volume_store - sums.attribute_store,
       0});
  return costs;
}

}  // namespace raymill
