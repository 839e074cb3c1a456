#include "storage/cache/page_cache.h"

#include <algorithm>
#include <cassert>
#include <utility>

namespace raymill::storage {
namespace {

constexpr std::size_t kMostResting = 16;

}  // namespace

std::uint64_t PageCache::table_bytes(std::uint32_t page_count, std::uint32_t frame_count) {
  constexpr std::uint64_t kPerPage = sizeof(std::atomic<const std::byte*>) + sizeof(std::atomic<std::uint8_t>) + 1;
  constexpr std::uint64_t kPerFrame = sizeof(PageId) + sizeof(std::uint32_t) + sizeof(Resting) + 1;
  return page_count * kPerPage + frame_count * kPerFrame;
}

Result<std::unique_ptr<PageCache>> PageCache::create(const Config& config, Ledger& ledger) {
  const std::uint64_t frame_bytes = std::uint64_t(config.frame_count) * config.page_bytes;
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation frames, ledger.claim(Tag::pages, frame_bytes));
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation tables,
                           ledger.claim(Tag::directory, table_bytes(config.page_count, config.frame_count)));
  std::unique_ptr<PageCache> cache(new PageCache(config));
  cache->arena_ = MappedMemory(frame_bytes, MappedMemory::Pages::huge);
  if (cache->arena_.data() == nullptr) {
    return {ErrorCode::budget_exceeded,
            "the system has no address space for " + format_bytes(frame_bytes) + " of pages"};
  }
  cache->frames_claim_ = std::move(frames);
  cache->tables_claim_ = std::move(tables);
  return cache;
}

PageCache::PageCache(const Config& config)
    : config_(config),
      images_(new std::atomic<const std::byte*>[config.page_count]()),
      touched_(new std::atomic<std::uint8_t>[config.page_count]()),
      states_(config.page_count, State::absent),
      page_in_frame_(config.frame_count, kNoPage),
      pin_epochs_(new std::atomic<std::uint64_t>[config.pin_slots]),
      eviction_(make_eviction(config.eviction)) {
  for (std::uint32_t frame = config.frame_count; frame-- > 0;) {
    free_frames_.push_back(frame);
  }
  resting_.reserve(config.frame_count);
  for (unsigned slot = 0; slot < config.pin_slots; ++slot) {
    pin_epochs_[slot].store(PagePin::kIdle);
  }
}

PagePin PageCache::pin(unsigned slot) {
  assert(slot < config_.pin_slots);
  // Sequentially consistent: the epoch is visible before any image is loaded, so evict() either sees this pin or has
  // taken the image away before the pin can find it.
  pin_epochs_[slot].store(epoch_.load(), std::memory_order_seq_cst);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  return PagePin(&pin_epochs_[slot]);
}

void PageCache::evict(std::uint32_t frame) {
  const PageId page = page_in_frame_[frame];
  assert(states_[index_of(page)] == State::resident);
  images_[index_of(page)].store(nullptr, std::memory_order_seq_cst);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  resting_.push_back({frame, epoch_.fetch_add(1)});
  page_in_frame_[frame] = kNoPage;
  states_[index_of(page)] = State::absent;
  ++evictions_;
  if (config_.on_evict) {
    config_.on_evict(page);
  }
}

void PageCache::drop(PageId page) {
  const auto at = std::find(page_in_frame_.begin(), page_in_frame_.end(), page);
  assert(at != page_in_frame_.end());
  evict(static_cast<std::uint32_t>(at - page_in_frame_.begin()));
}

void PageCache::reclaim() {
  if (resting_.empty()) {
    return;
  }
  std::uint64_t oldest = PagePin::kIdle;
  for (unsigned slot = 0; slot < config_.pin_slots; ++slot) {
    oldest = std::min(oldest, pin_epochs_[slot].load());
  }
  std::erase_if(resting_, [&](const Resting& resting) {
    if (resting.epoch >= oldest) {
      return false;
    }
    free_frames_.push_back(resting.frame);
    return true;
  });
}

bool PageCache::has_free_frame() {
  if (free_frames_.empty()) {
    reclaim();
  }
  return !free_frames_.empty();
}

std::optional<FrameLease> PageCache::begin_read(PageId page, const PageDemand& demand) {
  assert(states_[index_of(page)] == State::absent);
  // Frames rest until the pins of the moment are gone; a few rest at once, so that reads keep coming.
  const std::size_t most_resting =
      std::min<std::size_t>(kMostResting, std::max<std::uint32_t>(1, config_.frame_count / 4));
  if (!has_free_frame() && resting_.size() < most_resting) {
    const auto victim = eviction_->choose(page_in_frame_, demand, touched_.get());
    if (victim) {
      evict(*victim);
      reclaim();
    }
  }
  if (free_frames_.empty()) {
    return std::nullopt;
  }
  ++reads_begun_;
  const std::uint32_t frame = free_frames_.back();
  free_frames_.pop_back();
  states_[index_of(page)] = State::reading;
  return FrameLease{page, frame, {arena_.data() + std::uint64_t(frame) * config_.page_bytes, config_.page_bytes}};
}

void PageCache::publish(const FrameLease& lease) {
  assert(states_[index_of(lease.page)] == State::reading);
  states_[index_of(lease.page)] = State::resident;
  page_in_frame_[lease.frame] = lease.page;
  touched_[index_of(lease.page)].store(1, std::memory_order_relaxed);
  images_[index_of(lease.page)].store(lease.bytes.data(), std::memory_order_release);
}

void PageCache::abandon(const FrameLease& lease) {
  states_[index_of(lease.page)] = State::absent;
  free_frames_.push_back(lease.frame);
}

}  // namespace raymill::storage
