#include "traversal/ray_pool.h"

#include <utility>

namespace raymill::traversal {

Result<std::unique_ptr<RayPool>> RayPool::create(std::size_t record_bytes, std::uint32_t chunk_count,
                                                 storage::Ledger& ledger) {
  const std::uint64_t bytes = std::uint64_t(chunk_count) * kRayChunkBytes;
  RAYMILL_ASSIGN_OR_RETURN(storage::BudgetReservation reservation, ledger.claim(storage::Tag::rays, bytes));
  std::unique_ptr<RayPool> pool(new RayPool(record_bytes, chunk_count));
  pool->reservation_ = std::move(reservation);
  pool->arena_ = storage::MappedMemory(bytes);
  if (pool->arena_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for the rays in flight"};
  }
  return pool;
}

std::byte* RayPool::append(RayQueue& queue) {
  if (queue.head == kNoChunk || (header(queue.head).count + 1) * record_bytes_ > kRayChunkBytes - sizeof(ChunkHeader)) {
    std::uint32_t chunk = free_head_;
    if (chunk != kNoChunk) {
      free_head_ = header(chunk).next;
    } else if (never_used_ < chunk_count_) {
      chunk = never_used_++;
    } else {
      return nullptr;
    }
    header(chunk) = {queue.head, 0};
    queue.head = chunk;
  }
  ++queue.count;
  return records(queue.head) + header(queue.head).count++ * record_bytes_;
}

RayQueue RayPool::take(RayQueue& queue, std::uint32_t rays) {
  RayQueue taken{queue.head, 0};
  std::uint32_t last = kNoChunk;
  while (queue.head != kNoChunk && taken.count < rays) {
    last = queue.head;
    taken.count += header(last).count;
    queue.head = header(last).next;
  }
  queue.count -= taken.count;
  if (last != kNoChunk) {
    header(last).next = kNoChunk;
  }
  return taken;
}

void RayPool::release(RayQueue& queue) {
  while (queue.head != kNoChunk) {
    const std::uint32_t chunk = queue.head;
    queue.head = header(chunk).next;
    header(chunk).next = free_head_;
    free_head_ = chunk;
  }
  queue.count = 0;
}

}  // namespace raymill::traversal
