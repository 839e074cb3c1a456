// PageCache: frames of decoded pages, who may look at them, and which one goes when another must come.
//
//   absent --begin_read--> reading --publish--> resident --evict--> absent
//                             |                    |
//                             +--abandon--> absent +-- its frame rests until every PagePin from before is gone
//
// Frames have one size, so nothing fragments and the memory is exactly frame_count * page_bytes.
// Looking a page up is one atomic load. A PagePin keeps every page that was found through it in place until it goes;
// an evicted page's frame is given out again only when all pins that could have seen it are gone (epochs: Fraser 2004).
//
// Threads: find() and pin() from any thread; everything else under the owner's lock.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "storage/base/types.h"
#include "storage/cache/eviction.h"

namespace raymill::storage {

class PageCache;

/// Keeps pages in place for one thread. Move-only: a copy would end the first one's promise early.
class PagePin {
 public:
  PagePin() = default;
  PagePin(PagePin&& other) noexcept : epoch_(std::exchange(other.epoch_, nullptr)) {}
  PagePin& operator=(PagePin&& other) noexcept {
    release();
    epoch_ = std::exchange(other.epoch_, nullptr);
    return *this;
  }
  PagePin(const PagePin&) = delete;
  PagePin& operator=(const PagePin&) = delete;
  ~PagePin() { release(); }
  void release() {
    if (epoch_ != nullptr) {
      epoch_->store(kIdle, std::memory_order_release);
      epoch_ = nullptr;
    }
  }

 private:
  friend class PageCache;
  static constexpr std::uint64_t kIdle = ~std::uint64_t{0};
  explicit PagePin(std::atomic<std::uint64_t>* epoch) : epoch_(epoch) {}
  std::atomic<std::uint64_t>* epoch_ = nullptr;
};

/// A frame that is being filled.
struct FrameLease {
  PageId page = kNoPage;
  std::uint32_t frame = 0;
  std::span<std::byte> bytes;
};

class PageCache {
 public:
  struct Config {
    std::uint32_t page_count = 0;
    std::uint32_t page_bytes = 0;
    std::uint32_t frame_count = 0;
    unsigned pin_slots = 0;  ///< threads that may hold a PagePin
    EvictionKind eviction = EvictionKind::clock;
    std::function<void(PageId)> on_evict = {};  ///< told of each page that goes; none: nobody
  };

  /// Claims frames (Tag::pages) and tables (Tag::directory). Errors: budget_exceeded.
  static Result<std::unique_ptr<PageCache>> create(const Config& config, Ledger& ledger);
  static std::uint64_t table_bytes(std::uint32_t page_count, std::uint32_t frame_count);
  PageCache(const PageCache&) = delete;
  PageCache& operator=(const PageCache&) = delete;

  /// Pins for the thread that owns `slot`; at most one pin of a slot at a time.
  [[nodiscard]] PagePin pin(unsigned slot);
  /// The page's image, or null. Valid while a pin of the calling thread lives that was taken before.
  [[nodiscard]] const std::byte* find(PageId page) const {
    return images_[index_of(page)].load(std::memory_order_acquire);
  }
  [[nodiscard]] const std::atomic<const std::byte*>* images() const { return images_.get(); }
  /// Set by whoever enters a page; read and cleared by eviction.
  [[nodiscard]] std::atomic<std::uint8_t>* touched() const { return touched_.get(); }

  // Under the owner's lock:

  [[nodiscard]] bool absent(PageId page) const { return states_[index_of(page)] == State::absent; }
  [[nodiscard]] bool resident(PageId page) const { return states_[index_of(page)] == State::resident; }
  /// Whether there are frames that no page was ever read into. Not those whose page went: they are for the page that it
  /// went for.
  [[nodiscard]] bool has_unused_frame() const { return reads_begun_ < config_.frame_count; }
  /// Takes a frame for an absent page, by evicting if need be; empty when every page is wanted or still pinned.
  /// A resident page that rays wait for is never evicted.
  std::optional<FrameLease> begin_read(PageId page, const PageDemand& demand);
  void publish(const FrameLease& lease);
  void abandon(const FrameLease& lease);
  /// Evicts a resident page, whoever wants it. Looks at every frame: for tests.
  void drop(PageId page);

  [[nodiscard]] std::uint32_t frame_count() const { return config_.frame_count; }
  [[nodiscard]] std::uint64_t evictions() const { return evictions_; }

 private:
  enum class State : std::uint8_t { absent, reading, resident };
  struct Resting {
    std::uint32_t frame;
    std::uint64_t epoch;  // pins taken at or before it may still see the page
  };

  explicit PageCache(const Config& config);
  bool has_free_frame();
  void reclaim();
  void evict(std::uint32_t frame);

  const Config config_;
  BudgetReservation frames_claim_, tables_claim_;
  MappedMemory arena_;
  std::unique_ptr<std::atomic<const std::byte*>[]> images_;
  std::unique_ptr<std::atomic<std::uint8_t>[]> touched_;
  std::vector<State> states_;
  std::vector<PageId> page_in_frame_;  // kNoPage: none
  std::vector<std::uint32_t> free_frames_;
  std::vector<Resting> resting_;
  std::unique_ptr<std::atomic<std::uint64_t>[]> pin_epochs_;
  std::atomic<std::uint64_t> epoch_{0};
  const std::unique_ptr<Eviction> eviction_;
  std::uint64_t evictions_ = 0;
  std::uint64_t reads_begun_ = 0;
};

}  // namespace raymill::storage
