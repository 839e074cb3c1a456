#include "traversal/ray_pool.h"

#include <utility>

namespace raymill::traversal {

Result<std::unique_ptr<RayPool>> RayPool::create(RecordLayout layout, std::uint32_t chunk_count,
                                                 storage::Ledger& ledger) {
  const std::uint64_t bytes = std::uint64_t(chunk_count) * kRayChunkBytes;
  RAYMILL_ASSIGN_OR_RETURN(storage::BudgetReservation reservation, ledger.claim(storage::Tag::rays, bytes));
  std::unique_ptr<RayPool> pool(new RayPool(layout, chunk_count));
  pool->reservation_ = std::move(reservation);
  pool->arena_ = storage::MappedMemory(bytes);
  if (pool->arena_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for the rays in flight"};
  }
  return pool;
}

std::byte* RayPool::append(RayQueue& queue, std::size_t record_bytes) {
  if (queue.tail == kNoChunk || header(queue.tail).bytes + record_bytes > kRayChunkBytes - sizeof(ChunkHeader)) {
    std::uint32_t chunk = free_head_;
    if (chunk != kNoChunk) {
      free_head_ = header(chunk).next;
    } else if (never_used_ < chunk_count_) {
      chunk = never_used_++;
    } else {
      return nullptr;
    }
    --free_count_;
    header(chunk) = {kNoChunk, 0, 0};
    (queue.tail == kNoChunk ? queue.head : header(queue.tail).next) = chunk;
    queue.tail = chunk;
  }
  ++queue.count;
  ChunkHeader& tail = header(queue.tail);
  std::byte* record = records(queue.tail) + tail.bytes;
  ++tail.rays;
  tail.bytes = static_cast<std::uint16_t>(tail.bytes + record_bytes);
  return record;
}

void RayPool::move_head(RayQueue& from, RayQueue& to) {
  const std::uint32_t chunk = from.head;
  const std::uint32_t rays = header(chunk).rays;
  from.head = header(chunk).next;
  from.tail = from.head == kNoChunk ? kNoChunk : from.tail;
  from.count -= rays;
  (to.tail == kNoChunk ? to.head : header(to.tail).next) = chunk;
  to.tail = chunk;
  to.count += rays;
  header(chunk).next = kNoChunk;
}

RayQueue RayPool::take(RayQueue& queue, std::uint32_t rays) {
  RayQueue taken;
  while (queue.head != kNoChunk && taken.count < rays) {
    move_head(queue, taken);
  }
  return taken;
}

RayQueue RayPool::take_bytes(RayQueue& queue, std::size_t bytes, std::size_t& taken_bytes) {
  RayQueue taken;
  taken_bytes = 0;
  while (queue.head != kNoChunk && taken_bytes + header(queue.head).bytes <= bytes) {
    taken_bytes += header(queue.head).bytes;
    move_head(queue, taken);
  }
  return taken;
}

void RayPool::release(RayQueue& queue) {
  while (queue.head != kNoChunk) {
    const std::uint32_t chunk = queue.head;
    queue.head = header(chunk).next;
    header(chunk).next = free_head_;
    free_head_ = chunk;
    ++free_count_;
  }
  queue = {};
}

}  // namespace raymill::traversal
