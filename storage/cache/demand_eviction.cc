#include "storage/cache/demand_eviction.h"

#include <algorithm>

namespace raymill::storage {

std::optional<std::uint32_t> DemandEviction::choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                                    std::atomic<std::uint8_t>* touched) {
  const auto frames = static_cast<std::uint32_t>(page_in_frame.size());
  in_pool_.resize(frames);
  const auto may_go = [&](std::uint32_t frame) {
    const PageId page = page_in_frame[frame];
    return page != kNoPage && demand.waiting[index_of(page)] == 0;
  };
  // What was entered or is wanted leaves the pool.
  std::erase_if(pool_, [&](std::uint32_t frame) {
    in_pool_[frame] = may_go(frame) && touched[index_of(page_in_frame[frame])].load(std::memory_order_relaxed) == 0;
    return !in_pool_[frame];
  });
  // The hand fills it; it goes on for long only where nothing else is left. The first sweep clears every mark.
  for (std::uint32_t step = 0; step < 2 * frames && pool_.size() < kPool && (step < kPool || pool_.empty()); ++step) {
    const std::uint32_t frame = hand_;
    hand_ = hand_ + 1 == frames ? 0 : hand_ + 1;
    if (!in_pool_[frame] && may_go(frame) &&
        touched[index_of(page_in_frame[frame])].exchange(0, std::memory_order_relaxed) == 0) {
      pool_.push_back(frame);
      in_pool_[frame] = true;
    }
  }
  const auto future = [&](std::uint32_t frame) {
    return demand.future.empty() ? 0 : demand.future[index_of(page_in_frame[frame])].load(std::memory_order_relaxed);
  };
  const auto least = std::min_element(pool_.begin(), pool_.end(),
                                      [&](std::uint32_t a, std::uint32_t b) { return future(a) < future(b); });
  if (least == pool_.end()) {
    return std::nullopt;
  }
  const std::uint32_t frame = *least;
  in_pool_[frame] = false;
  pool_.erase(least);
  return frame;
}

}  // namespace raymill::storage
