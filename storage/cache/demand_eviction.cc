#include "storage/cache/demand_eviction.h"

#include <utility>

namespace raymill::storage {

std::optional<std::uint32_t> DemandEviction::choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                                    std::atomic<std::uint8_t>* touched) {
  const auto frames = static_cast<std::uint32_t>(page_in_frame.size());
  std::optional<std::uint32_t> best;
  std::pair<std::int32_t, std::uint8_t> least;  // future demand, entered lately
  for (std::uint32_t step = 0, looked = 0; step < frames && looked < kLooked; ++step) {
    const std::uint32_t frame = hand_;
    hand_ = hand_ + 1 == frames ? 0 : hand_ + 1;
    const PageId page = page_in_frame[frame];
    if (page == kNoPage || demand.waiting[index_of(page)] > 0) {
      continue;
    }
    ++looked;
    const std::int32_t future =
        demand.future.empty() ? 0 : demand.future[index_of(page)].load(std::memory_order_relaxed);
    const std::pair candidate{future, touched[index_of(page)].exchange(0, std::memory_order_relaxed)};
    if (!best || candidate < least) {
      best = frame;
      least = candidate;
    }
  }
  return best;
}

}  // namespace raymill::storage
