// PageScheduler: which page's rays run next, and which page is read next.
//
//   rays wait at a page --resident--> ready (first in, first out)
//                       --absent----> wanted: lists by log2(rays waiting), the fullest list first
//
// Every kAgeInterval-th read takes the head of the emptiest list instead, so no page waits for ever. All operations
// take constant time: scanning for the fullest queue is quadratic (FACTS). Thread-confined (the owner's lock).
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/types.h"

namespace raymill::traversal {

enum class PageState : std::uint8_t { absent, reading, resident };

class PageScheduler {
 public:
  explicit PageScheduler(std::uint32_t page_count);
  static std::uint64_t bytes(std::uint32_t page_count);

  /// `rays` more wait at the page.
  void add(storage::PageId page, std::uint32_t rays, PageState state);
  /// `rays` fewer wait there.
  void remove(storage::PageId page, std::uint32_t rays);
  /// The page is being read: it is no candidate any more.
  void reading(storage::PageId page);
  /// The page came in, or could not be read and is a candidate again.
  void arrived(storage::PageId page, bool resident);

  [[nodiscard]] bool has_ready() const { return !ready_.empty(); }
  /// A resident page with rays waiting; it leaves the list.
  std::optional<storage::PageId> take_ready();
  /// Puts the page back if rays still wait there.
  void give_back(storage::PageId page);
  /// The page to read next among those with at least `least_rays` waiting; it stays a candidate.
  std::optional<storage::PageId> next_wanted(std::uint32_t least_rays);

  /// Rays waiting for each page.
  [[nodiscard]] std::span<const std::uint32_t> demand() const { return demand_; }
  [[nodiscard]] bool anything_wanted() const { return wanted_count_ > 0; }

 private:
  static constexpr unsigned kLists = 32;
  static constexpr std::uint8_t kNotListed = 0xFF;
  static constexpr unsigned kAgeInterval = 64;
  void list(std::uint32_t page);
  void unlist(std::uint32_t page);
  void make_ready(std::uint32_t page);

  struct Links {
    std::uint32_t previous, next;
  };
  struct List {
    std::uint32_t head, tail;
  };
  std::vector<std::uint32_t> demand_;
  std::vector<Links> links_;
  std::vector<std::uint8_t> list_of_;
  std::vector<bool> is_ready_;
  std::array<List, kLists> lists_;
  std::deque<std::uint32_t> ready_;
  std::uint32_t wanted_count_ = 0;
  unsigned picks_ = 0;
};

}  // namespace raymill::traversal
