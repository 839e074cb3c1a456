#include "traversal/future_demand.h"

#include <utility>

namespace raymill::traversal {

FutureDemand::FutureDemand(std::uint32_t page_count, unsigned width)
    : page_count_(page_count), width_(width), counts_(new std::atomic<std::int32_t>[page_count]()) {}

FutureDemand::Share::Share(std::shared_ptr<FutureDemand> all)
    : all_(std::move(all)), counts_(new std::atomic<std::int32_t>[all_->page_count_]()) {}

FutureDemand::Share::~Share() {
  for (std::uint32_t page = 0; page < all_->page_count_; ++page) {
    all_->counts_[page].fetch_sub(counts_[page].load(std::memory_order_relaxed), std::memory_order_relaxed);
  }
}

void FutureDemand::Share::add(std::uint32_t page, std::int32_t step) {
  counts_[page].fetch_add(step, std::memory_order_relaxed);
  all_->counts_[page].fetch_add(step, std::memory_order_relaxed);
}

void FutureDemand::Share::taken_up(std::span<const RayState> rays, const std::byte* image) {
  for (const RayState& ray : rays) {
    if (sampled(ray)) {
      count(ray, {image, ray.page, ray.node}, -1);
    }
  }
}

void FutureDemand::Share::put_back(std::span<const RayState> rays, std::uint32_t page, const std::byte* image) {
  for (const RayState& ray : rays) {
    if (sampled(ray) && !ray.done) {
      count(ray, ray.left.image != nullptr ? ray.left : LeftNode{image, page, ray.node}, 1);
    }
  }
}

// A place that does not fit (a reference of a damaged store) counts nothing, when the ray parks and when it comes back.
void FutureDemand::Share::count(const RayState& ray, const LeftNode& from, std::int32_t step) {
  const storage::PageHeader& header = storage::PageView(from.image).header();
  if (from.node >= header.node_count + header.ghost_count) {
    return;
  }
  const auto visit = [&](std::uint32_t page) { add(page, step); };
  if (all_->width_ == 8) {
    for_each_pending_page<8>(from.image, from.page, from.node, ray, visit);
  } else {
    for_each_pending_page<4>(from.image, from.page, from.node, ray, visit);
  }
}

}  // namespace raymill::traversal
