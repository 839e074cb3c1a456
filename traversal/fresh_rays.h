// FreshRays: rays of a job on their way to the expanded layout, as they were pushed.
//
//   push(): take() --> fill --> put() ----> worker: next() --> kernel --> give_back()
//
// There a ray runs from the root to its end and waits for nothing, so it never becomes a record: a block of rays is
// filled by push() and traced by one worker, and neither needs the lock meanwhile. Thread-compatible under the owner's
// lock; a block that was taken belongs to who took it.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "traversal/query.h"

namespace raymill::traversal {

class FreshRays {
 public:
  static constexpr std::size_t kBlockRays = 1024;
  /// Valid rays of one chunk of the result window.
  struct Block {
    std::uint32_t count;
    PrimitiveIds* skipped;  // null where rays bring none
    std::uint32_t* masks;   // as well
    std::array<std::uint32_t, kBlockRays> numbers;
    std::array<Ray, kBlockRays> rays;

    [[nodiscard]] RayExtras extras() const {
      return {{skipped, skipped != nullptr ? count : 0}, {masks, masks != nullptr ? count : 0}};
    }
  };
  struct Config {
    unsigned threads = 1;
    bool skipped = false;  ///< rays bring primitives to skip
    bool masks = false;    ///< rays bring masks
  };

  static std::uint64_t bytes(const Config& config);
  /// Claims bytes() (Tag::rays). Errors: budget_exceeded.
  static Result<std::unique_ptr<FreshRays>> create(const Config& config, storage::Ledger& ledger);

  [[nodiscard]] bool has_room() const { return !free_.empty(); }
  /// Whether so many are free that whoever waits for room is worth waking.
  [[nodiscard]] bool has_much_room() const { return free_.size() >= count_ / 2; }
  /// An empty block; there must be room.
  Block* take();
  /// The block's rays wait for a worker.
  void put(Block* block) { ready_.push_back(block); }
  [[nodiscard]] bool has_ready() const { return !ready_.empty(); }
  /// The block that waits longest; there must be one.
  Block* next();
  /// The block is empty again.
  void give_back(Block* block) { free_.push_back(block); }
  /// Drops the rays that wait.
  void clear();

 private:
  static std::uint64_t blocks_for(unsigned threads);
  static std::uint64_t block_bytes(const Config& config);

  FreshRays(const Config& config, storage::BudgetReservation claim);

  storage::BudgetReservation claim_;
  const std::uint64_t count_;
  storage::MappedMemory memory_;
  std::vector<Block*> free_;
  std::deque<Block*> ready_;
};

}  // namespace raymill::traversal
