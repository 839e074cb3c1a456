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

std::uint64_t FreshRays::block_bytes(const Config& config) {
  return sizeof(Block) +
         kBlockRays * ((config.skipped ? sizeof(PrimitiveIds) : 0) + (config.masks ? sizeof(std::uint32_t) : 0));
}

std::uint64_t FreshRays::bytes(const Config& config) {
  // Beside a block two places in lists, of which the longer one grows by doubling.
  return blocks_for(config.threads) * (block_bytes(config) + 4 * sizeof(Block*));
}

Result<std::unique_ptr<FreshRays>> FreshRays::create(const Config& config, storage::Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(auto claim, ledger.claim(storage::Tag::rays, bytes(config)));
  std::unique_ptr<FreshRays> rays(new FreshRays(config, std::move(claim)));
  if (rays->memory_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for rays that were pushed"};
  }
  return rays;
}

FreshRays::FreshRays(const Config& config, storage::BudgetReservation claim)
    : claim_(std::move(claim)),
      count_(blocks_for(config.threads)),
      memory_(blocks_for(config.threads) * block_bytes(config)) {
  static_assert(std::is_trivially_copyable_v<Block> && sizeof(Block) % alignof(PrimitiveIds) == 0);
  free_.reserve(count_);
  for (std::uint64_t i = memory_.data() != nullptr ? count_ : 0; i-- > 0;) {
    std::byte* at = memory_.data() + i * block_bytes(config);
    auto* block = reinterpret_cast<Block*>(at);
    at += sizeof(Block);
    block->skipped = config.skipped ? reinterpret_cast<PrimitiveIds*>(at) : nullptr;
    at += config.skipped ? kBlockRays * sizeof(PrimitiveIds) : 0;
    block->masks = config.masks ? reinterpret_cast<std::uint32_t*>(at) : nullptr;
    free_.push_back(block);
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
