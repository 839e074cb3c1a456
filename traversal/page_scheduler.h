// PageScheduler: which page's rays run next, and which page is read next.
//
//   rays wait at a page --resident--> ready (first in, first out)
//                       --absent----> wanted: the ReadPolicy's choice
//
// Whatever the policy, every kAgeInterval-th read is the page that was wanted longest, so a page is read at the latest
// after kAgeInterval times as many reads as pages were wanted before it. All operations take constant time but a
// sweep's (a bit for each page): scanning for the fullest queue is quadratic (FACTS). Thread-confined (the owner's
// lock).
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/types.h"
#include "traversal/page_list.h"
#include "traversal/read_policy.h"

namespace raymill::traversal {

enum class PageState : std::uint8_t { absent, reading, resident };

class PageScheduler {
 public:
  static constexpr unsigned kAgeInterval = 64;

  PageScheduler(std::uint32_t page_count, std::unique_ptr<ReadPolicy> policy);
  static std::uint64_t bytes(std::uint32_t page_count);

  /// `rays` more wait at the page.
  void add(storage::PageId page, std::uint32_t rays, PageState state);
  /// `rays` fewer wait there.
  void remove(storage::PageId page, std::uint32_t rays);
  /// The page is being read: it is no candidate any more.
  void reading(storage::PageId page);
  /// The page came in, or could not be read and is a candidate again.
  void arrived(storage::PageId page, bool resident);
  /// The page was evicted although rays wait there.
  void dropped(storage::PageId page);

  [[nodiscard]] bool has_ready() const { return ready_count_ > 0; }
  /// A resident page with rays waiting; it leaves the list.
  std::optional<storage::PageId> take_ready();
  /// Puts the page back if rays still wait there.
  void give_back(storage::PageId page);
  /// The page to read next; it stays a candidate.
  std::optional<storage::PageId> next_wanted();
  /// The page that was wanted longest; it stays a candidate.
  [[nodiscard]] std::optional<storage::PageId> longest_wanted() const;

  /// Rays waiting for each page.
  [[nodiscard]] std::span<const std::uint32_t> demand() const { return demand_; }
  /// Absent pages that rays wait for and nobody reads, and those rays.
  [[nodiscard]] std::uint32_t wanted_count() const { return wanted_count_; }
  [[nodiscard]] std::uint64_t wanted_rays() const { return wanted_rays_; }
  /// More than half of the rays that wait for the fullest of these pages, never more than all of them.
  [[nodiscard]] std::uint32_t most_wanted_rays() const;

 private:
  void want(std::uint32_t page);
  void unwant(std::uint32_t page);
  void tell(std::uint32_t page, std::uint32_t rays);
  void make_ready(std::uint32_t page);
  void unready(std::uint32_t page);

  std::unique_ptr<ReadPolicy> policy_;
  std::vector<std::uint32_t> demand_;
  PageList by_age_;  // of the wanted pages
  std::vector<bool> is_ready_;
  std::deque<std::uint32_t> ready_;  // pages that are not ready any more may stand in it
  std::uint32_t ready_count_ = 0;    // of those that are
  std::uint32_t wanted_count_ = 0;
  std::uint64_t wanted_rays_ = 0;
  std::vector<std::uint32_t> counted_;             // rays of each page in wanted_rays_
  std::array<std::uint32_t, 33> pages_by_rays_{};  // wanted pages, by the bit width of their rays
  unsigned picks_ = 0;
};

}  // namespace raymill::traversal
