// GroupTurns: whose turn it is when pages must go for other pages. One group of pages at a time is read, in the file's
// order, so that rays go from page to page of the group without waiting; then the next group has its turn.
//
//   choose a group --> its rays come back from disk --> pages that enough rays want, again and again --> none left
//         ^---------------------------------------------------------------------------------------------------'
//
// A page that hardly any ray wants is left for a later turn, when more may want it: in a turn a page is read when a
// quarter of what the group has for each page on average wait there. Every kAgeTurns-th turn is of the group that had
// none for longest, and all that it wants is read: so a ray is served at the latest after kAgeTurns turns for each
// group. Thread-confined (the owner's lock).
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "traversal/read_policy.h"

namespace raymill::traversal {

class GroupTurns {
 public:
  static constexpr unsigned kAgeTurns = 16;
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;

  struct Config {
    std::uint32_t page_count = 0;
    std::uint32_t group_pages = 0;
    ReadOrder order = ReadOrder::score;
    std::function<std::uint32_t(std::uint32_t page)> encoded_bytes;
  };
  /// Who waits where.
  struct Source {
    std::function<std::uint64_t(std::uint32_t group)> rays_on_disk;
    std::function<std::uint32_t(std::uint32_t page)> wanted_rays;  ///< in memory; 0 unless the page could be read
  };
  GroupTurns(const Config& config, Source source);
  static std::uint64_t bytes(std::uint32_t page_count, std::uint32_t group_pages);

  /// The page to be read next; none where no ray in memory waits for one, or more rays of the group come back first.
  std::optional<std::uint32_t> next_page();
  /// The group whose turn it is; kNone before the first.
  [[nodiscard]] std::uint32_t active() const { return active_; }
  /// Begins the first turn if there was none, or the next if all that the group has is too little.
  void look();
  /// No more rays of the active group can come back for now: what is in memory is to be read, however little.
  void read_everything() { least_ = 1; }

 private:
  [[nodiscard]] std::optional<std::uint32_t> scan();
  bool next_turn();
  [[nodiscard]] std::uint32_t choose(ReadOrder order) const;
  [[nodiscard]] std::uint64_t rays(std::uint32_t group) const;
  [[nodiscard]] double value(std::uint32_t group, std::uint64_t rays, ReadOrder order) const;
  [[nodiscard]] std::uint32_t first_page(std::uint32_t group) const { return group * config_.group_pages; }
  [[nodiscard]] std::uint32_t end_page(std::uint32_t group) const {
    return std::min(first_page(group) + config_.group_pages, config_.page_count);
  }

  const Config config_;
  const Source source_;
  std::vector<std::uint64_t> group_bytes_;  // encoded
  std::vector<std::uint64_t> last_turn_;    // of each group
  std::uint64_t turn_ = 0;
  std::uint32_t active_ = kNone;
  std::uint32_t cursor_ = 0;  // page
  std::uint32_t least_ = 1;   // rays that a page needs
};

}  // namespace raymill::traversal
