// The least future demand: waiting rays say, by the children that they still have to visit, where they go next, so the
// page that the fewest of them name goes. What Belady's rule does with the whole future, this does with the part that
// is known. Rays that run on through resident pages name none before they wait; what those enter is told by the clock.
//
//   frames --the hand, those not entered since it last passed--> pool of kPool --the least future demand--> gone
//                                                                  |
//                                               entered or wanted: back among the others
//
// The larger the pool, the better the choice and the longer a page has to be entered again; kPool bounds the time that
// a choice takes. Thread-confined.
#pragma once

#include <vector>

#include "storage/cache/eviction.h"

namespace raymill::storage {

class DemandEviction final : public Eviction {
 public:
  static constexpr std::uint32_t kPool = 256;

  std::optional<std::uint32_t> choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                      std::atomic<std::uint8_t>* touched) override;

 private:
  std::uint32_t hand_ = 0;
  std::vector<std::uint32_t> pool_;  // frames, the longest there first
  std::vector<bool> in_pool_;        // [frame]
};

}  // namespace raymill::storage
