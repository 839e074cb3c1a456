#include "storage/io/store_costs.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <span>
#include <utility>

#include "storage/base/aligned.h"
#include "storage/io/store_file.h"
#include "storage/pages/codec.h"
#include "storage/pages/mask_page.h"
#include "storage/volume/volume_page.h"

namespace raymill {
namespace {

using namespace storage;

constexpr std::uint64_t kLookBudgetBytes = gibibytes(4);
// Blocks that hold a page's head, wherever in the first one it begins.
constexpr std::uint64_t kHeadBytes = 2 * kDirectBlockBytes;
static_assert(sizeof(EncodedHeader) <= kDirectBlockBytes);

using HeadBuffer = std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>>;

// What pages hold, summed.
struct Sums {
  std::uint64_t triangle_pages = 0, triangle_store = 0, triangle_decoded = 0;
  std::uint64_t volume_pages = 0, volume_store = 0, volume_decoded = 0;
  std::uint64_t mask_pages = 0, mask_store = 0, mask_decoded = 0;  // decoded: with the sections of masked pages
  std::uint64_t geometry_bytes = 0, instance_bytes = 0;
};

// A page's image without its section of masks.
std::uint64_t bytes_before_masks(const EncodedHeader& head) {
  PageHeader header;
  header.width = head.width;
  header.geometry_index_bytes = head.geometry_index_bytes;
  header.node_count = head.node_count;
  header.ghost_count = head.ghost_count;
  header.external_count = head.external_count;
  header.triangle_count = head.triangle_count;
  header.vertex_count = head.vertex_count;
  header.geometry_count = head.geometry_count;
  header.instance_count = head.instance_count;
  lay_out(header);
  return header.image_bytes;
}

Result<EncodedHeader> read_head(const StoreFile& store, PageId page, HeadBuffer& buffer) {
  PageBlocks blocks = store.blocks_of(page);
  blocks.bytes = std::min(blocks.bytes, kHeadBytes);
  EncodedHeader head;
  if (store.read_blocks(blocks, buffer) < blocks.skipped + sizeof head) {
    return store.page_fault(page, {ErrorCode::io, "cannot be read; the file may be cut short, or the disk be failing"});
  }
  std::memcpy(&head, buffer.data() + blocks.skipped, sizeof head);
  const bool of_triangles = head.page_type == kPageTypeTriangles || head.page_type == kPageTypeMasked;
  const bool known = head.page_type == kPageTypeVolume || head.page_type == kPageTypeMask ||
                     (of_triangles && head.geometry_index_bytes <= 2);
  if (!known) {
    return store.page_fault(page, {ErrorCode::corrupt, "begins with no page's head; build the store again"});
  }
  return head;
}

Status add_page(const StoreFile& store, PageId page, HeadBuffer& buffer, Sums& sums) {
  const PageEntry& entry = store.entry(page);
  RAYMILL_ASSIGN_OR_RETURN(const EncodedHeader head, read_head(store, page, buffer));
  if (head.page_type == kPageTypeVolume) {
    ++sums.volume_pages;
    sums.volume_store += entry.encoded_bytes;
    sums.volume_decoded += entry.decoded_bytes;
    return {};
  }
  if (head.page_type == kPageTypeMask) {
    ++sums.mask_pages;
    sums.mask_store += entry.encoded_bytes;
    sums.mask_decoded += entry.decoded_bytes;
    return {};
  }
  const std::uint64_t before_masks =
      head.page_type == kPageTypeMasked ? bytes_before_masks(head) : std::uint64_t{entry.decoded_bytes};
  const std::uint64_t geometries = std::uint64_t(head.geometry_count) * sizeof(std::uint32_t) +
                                   std::uint64_t(head.triangle_count) * head.geometry_index_bytes;
  const std::uint64_t instances = std::uint64_t(head.instance_count) * sizeof(Instance);
  if (geometries + instances > before_masks || before_masks > entry.decoded_bytes) {
    return store.page_fault(page, {ErrorCode::corrupt, "has a head that asks for more than the page; build it again"});
  }
  ++sums.triangle_pages;
  sums.triangle_store += entry.encoded_bytes;
  sums.triangle_decoded += before_masks - geometries - instances;
  sums.mask_decoded += entry.decoded_bytes - before_masks;
  sums.geometry_bytes += geometries;
  sums.instance_bytes += instances;
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
  // Of masked pages the store's bytes are the triangles'.
  add(Feature::masks, {"masks", sums.mask_pages, sums.mask_store, sums.mask_decoded});
  add(Feature::volumes, {"volumes", sums.volume_pages, sums.volume_store, sums.volume_decoded});
  costs.push_back(
      {"file", 0, store->footer().file_bytes - sums.triangle_store - sums.volume_store - sums.mask_store, 0});
  return costs;
}

}  // namespace raymill
