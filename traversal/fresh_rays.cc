#include "traversal/fresh_rays.h"

#include <algorithm>
#include <type_traits>
#include <utility>

namespace raymill::traversal {
namespace {

// 1.2 MB: while few workers run these, push() fills as many.
constexpr std::uint64_t kLeastBlocks = 32;
constexpr std::uint64_t kBlocksPerThread = 4;

}  // namespace

std::uint64_t FreshRays::blocks_for(unsigned threads) { return std::max(kLeastBlocks, threads * kBlocksPerThread); }

Result<std::unique_ptr<FreshRays>> FreshRays::create(unsigned threads, storage::Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(auto claim, ledger.claim(storage::Tag::rays, bytes(threads)));
  std::unique_ptr<FreshRays> rays(new FreshRays(blocks_for(threads), std::move(claim)));
  if (rays->memory_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for rays that were pushed"};
  }
  return rays;
}

FreshRays::FreshRays(std::uint64_t blocks, storage::BudgetReservation claim)
    : claim_(std::move(claim)), count_(blocks), memory_(blocks * sizeof(Block)) {
  static_assert(std::is_trivially_copyable_v<Block>);
  free_.reserve(blocks);
  for (std::uint64_t i = memory_.data() != nullptr ? blocks : 0; i-- > 0;) {
    free_.push_back(reinterpret_cast<Block*>(memory_.data() + i * sizeof(Block)));
  }
}

FreshRays::Block* FreshRays::take() {
  Block* block = free_.back();
  free_.pop_back();
  block->count = 0;
  return block;
}

FreshRays::Block* FreshRays::next() {
  Block* block = ready_.front();
  ready_.pop_front();
  return block;
}

void FreshRays::clear() {
  while (has_ready()) {
    give_back(next());
  }
}

}  // namespace raymill::traversal
