// WaitingRays: the rays of one job that wait, in memory by page and on disk by group of pages.
//
//   append(page) --> queue of the page --> take(page)
//                        |     ^
//    detach, store, retire     fetch, accept
//                        v     |
//              extents of the page's group: page, rays, records; page, rays, records; ...
//
// A group is a range of pages that follow each other in the file, so they are near each other in space; it is as large
// as memory can hold at once. Rays go to disk and come back by the group, so both are a few large transfers. An extent
// carries a checksum. Thread-compatible under the owner's lock but store() and fetch(), which need none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/base/types.h"
#include "traversal/ray_pool.h"
#include "traversal/spill_file.h"

namespace raymill::traversal {

class WaitingRays {
 public:
  struct Config {
    RecordLayout layout;
    std::uint32_t page_count = 0;
    std::uint32_t group_pages = 0;
    std::uint32_t pool_chunks = 0;
    std::size_t extent_bytes = 0;  ///< a multiple of SpillFile::kAlignment
    std::uint32_t most_extents = 0;
    std::string directory;
  };
  /// Claims the pool and the tables (Tag::rays). Errors: budget_exceeded.
  static Result<std::unique_ptr<WaitingRays>> create(const Config& config, storage::Ledger& ledger);
  /// Of the tables, the pool apart.
  static std::uint64_t table_bytes(const Config& config);
  /// Of a buffer for store() and fetch(), with what goes along.
  static std::uint64_t transfer_bytes(std::size_t extent_bytes);
  /// Pages whose rays share an extent, at most; bounds the chunks that an extent needs when it comes back.
  static constexpr std::uint32_t most_parts(std::size_t extent_bytes) {
    return static_cast<std::uint32_t>(extent_bytes / 256);
  }

  // In memory.

  [[nodiscard]] RayPool& pool() { return *pool_; }
  [[nodiscard]] std::uint32_t count(storage::PageId page) const { return queues_[index_of(page)].count; }
  /// Room for a record more at the page; null when the pool is empty.
  std::byte* append(storage::PageId page, std::size_t record_bytes);
  /// Takes whole chunks until at least `rays` are out or none is left; they go back with pool().release().
  RayQueue take(storage::PageId page, std::uint32_t rays);

  /// Chunks that are neither used nor promised to rays in somebody's hands: each of those may need one.
  [[nodiscard]] std::uint32_t free_chunks() const {
    return pool_->free_chunks() > promised_ ? pool_->free_chunks() - promised_ : 0;
  }
  void promise(std::uint32_t chunks) { promised_ += chunks; }
  void settle(std::uint32_t chunks) { promised_ -= chunks; }

  // Groups.

  [[nodiscard]] std::uint32_t group_count() const { return static_cast<std::uint32_t>(groups_.size()); }
  [[nodiscard]] std::uint32_t group_of(storage::PageId page) const { return index_of(page) / config_.group_pages; }
  [[nodiscard]] std::uint32_t group_pages() const { return config_.group_pages; }
  [[nodiscard]] std::uint32_t memory_rays(std::uint32_t group) const { return groups_[group].memory_rays; }
  [[nodiscard]] std::uint64_t disk_rays(std::uint32_t group) const { return groups_[group].disk_rays; }
  [[nodiscard]] std::uint64_t rays_on_disk() const { return rays_on_disk_; }
  /// Whether rays may still be taken in: extents are counted, and a part is kept for those that are here.
  [[nodiscard]] bool has_extents_left() const { return extent_count_ < config_.most_extents / 4 * 3; }

  // To disk.

  struct Part {
    storage::PageId page;
    std::uint32_t bytes;
    RayQueue rays;
  };
  struct Parcel {
    std::uint32_t group = 0;
    std::uint32_t place = 0;
    std::uint32_t rays = 0;
    std::size_t bytes = 0;
    std::uint64_t checksum = 0;
    std::vector<Part> parts;
  };
  /// Takes rays of the group's pages for which may_go(page) holds out of their queues, as many as an extent holds.
  template <typename MayGo>
  Parcel detach(std::uint32_t group, MayGo&& may_go) {
    Parcel parcel = begin_parcel(group);
    const std::uint32_t begin = group * config_.group_pages;
    const std::uint32_t end = std::min(begin + config_.group_pages, config_.page_count);
    for (std::uint32_t page = begin; page < end && !full(parcel); ++page) {
      if (queues_[page].count > 0 && may_go(storage::PageId{page})) {
        add_part(parcel, storage::PageId{page});
      }
    }
    return parcel;
  }
  /// Writes the parcel. `buffer`: extent_bytes, aligned to SpillFile::kAlignment. Errors: io, disk_full.
  Status store(Parcel& parcel, std::span<std::byte> buffer);
  /// Gives the parcel's memory back; its rays are the group's on disk from now on.
  void retire(Parcel& parcel);

  // And back.

  struct Extent {
    std::uint32_t place = 0;
    std::uint32_t bytes = 0;
    std::uint32_t rays = 0;
    std::uint32_t parts = 0;
    std::uint64_t checksum = 0;
    std::uint64_t number = 0;  ///< rising with time
  };
  /// The group's oldest extent, null when it has none.
  [[nodiscard]] const Extent* oldest(std::uint32_t group) const {
    const auto& extents = groups_[group].extents;
    return extents.empty() ? nullptr : &extents.front();
  }
  /// Chunks that the extent's rays surely fit in.
  [[nodiscard]] std::uint32_t chunks_for(const Extent& extent) const;
  /// Takes the group's oldest extent off the list.
  Extent begin_fetch(std::uint32_t group);
  /// Reads it into `buffer` and checks it. Errors: io, checksum_mismatch.
  Status fetch(const Extent& extent, std::span<std::byte> buffer) const;
  /// Puts the rays into their queues; calls arrived(page, rays) for each page. There must be chunks_for(extent) free.
  template <typename Arrived>
  void accept(const Extent& extent, std::span<const std::byte> buffer, Arrived&& arrived) {
    std::size_t at = 0;
    for (std::uint32_t i = 0; i < extent.parts; ++i) {
      const PartHeader header = read_header(buffer, at);
      append_records(header, buffer.subspan(at, header.bytes));
      at += header.bytes;
      arrived(storage::PageId{header.page}, header.rays);
    }
    file_.give(extent.place);
  }

  [[nodiscard]] std::uint64_t spilled_bytes() const { return spilled_bytes_; }
  [[nodiscard]] std::uint64_t fetched_bytes() const { return fetched_bytes_; }

 private:
  struct PartHeader {
    std::uint32_t page, rays, bytes;
  };
  struct Group {
    std::uint32_t memory_rays = 0;
    std::uint64_t disk_rays = 0;
    std::vector<Extent> extents;  // oldest first
  };

  WaitingRays(const Config& config, std::unique_ptr<RayPool> pool, storage::BudgetReservation claim);
  Parcel begin_parcel(std::uint32_t group);
  [[nodiscard]] bool full(const Parcel& parcel) const;
  void add_part(Parcel& parcel, storage::PageId page);
  static PartHeader read_header(std::span<const std::byte> buffer, std::size_t& at);
  void append_records(const PartHeader& header, std::span<const std::byte> records);

  const Config config_;
  storage::BudgetReservation claim_;
  std::unique_ptr<RayPool> pool_;
  std::vector<RayQueue> queues_;  // [page]
  std::vector<Group> groups_;
  SpillFile file_;
  std::uint32_t promised_ = 0;
  std::uint32_t extent_count_ = 0;
  std::uint64_t next_extent_ = 0;
  std::uint64_t rays_on_disk_ = 0;
  std::uint64_t spilled_bytes_ = 0;
  std::uint64_t fetched_bytes_ = 0;
};

}  // namespace raymill::traversal
