// The clock: a hand sweeps the frames; a page that was entered since the hand last passed is spared once.
// Thread-confined.
#pragma once

#include "storage/cache/eviction.h"

namespace raymill::storage {

class ClockEviction final : public Eviction {
 public:
  /// Two sweeps at most: the first clears every mark.
  std::optional<std::uint32_t> choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                      std::atomic<std::uint8_t>* touched) override;

 private:
  std::uint32_t hand_ = 0;
};

}  // namespace raymill::storage
