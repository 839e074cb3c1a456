// Which resident page goes: the clock. A hand sweeps the frames; a page that was entered since the hand last passed is
// spared once; pages that rays wait for are never chosen. Thread-confined.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/types.h"

namespace raymill::storage {

class ClockEviction {
 public:
  /// The frame to give up, or empty when all are spared. Two sweeps at most: the first clears every mark.
  std::optional<std::uint32_t> choose(const std::vector<PageId>& page_in_frame, std::span<const std::uint32_t> demand,
                                      std::atomic<std::uint8_t>* touched);

 private:
  std::uint32_t hand_ = 0;
};

}  // namespace raymill::storage
