#include "storage/cache/clock_eviction.h"

namespace raymill::storage {

std::optional<std::uint32_t> ClockEviction::choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                                   std::atomic<std::uint8_t>* touched) {
  const auto frames = static_cast<std::uint32_t>(page_in_frame.size());
  for (std::uint32_t step = 0; step < 2 * frames; ++step) {
    const std::uint32_t frame = hand_;
    hand_ = hand_ + 1 == frames ? 0 : hand_ + 1;
    const PageId page = page_in_frame[frame];
    if (page == kNoPage || demand.waiting[index_of(page)] > 0) {
      continue;
    }
    if (touched[index_of(page)].exchange(0, std::memory_order_relaxed) == 0) {
      return frame;
    }
  }
  return std::nullopt;
}

}  // namespace raymill::storage
