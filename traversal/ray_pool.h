// RayPool: where rays wait. Queues of fixed-size records in small chunks from one arena.
//
//   RayQueue -> chunk -> chunk -> chunk      chunk: next, count, records
//
// A chunk is small because most pages have few rays waiting: half a chunk a queue is what containers waste.
// Thread-compatible: the owner's lock guards it; records of chunks taken out may be read without.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"

namespace raymill::traversal {

constexpr std::uint32_t kNoChunk = 0xFFFFFFFFu;
constexpr std::size_t kRayChunkBytes = 512;
constexpr std::uint64_t kMostBatches = 256;  ///< workers of one store

struct RayQueue {
  std::uint32_t head = kNoChunk;
  std::uint32_t count = 0;  ///< rays
};

class RayPool {
 public:
  /// Claims chunk_count * kRayChunkBytes (Tag::rays). Errors: budget_exceeded.
  static Result<std::unique_ptr<RayPool>> create(std::size_t record_bytes, std::uint32_t chunk_count,
                                                 storage::Ledger& ledger);
  RayPool(const RayPool&) = delete;
  RayPool& operator=(const RayPool&) = delete;

  static std::size_t records_per_chunk(std::size_t record_bytes) {
    return (kRayChunkBytes - sizeof(ChunkHeader)) / record_bytes;
  }
  /// Chunks that hold any spread of `rays` over `queues` queues: each queue has at most one chunk that is not full, and
  /// so has each batch that a worker has taken out.
  static std::uint64_t chunks_needed(std::uint64_t rays, std::uint64_t queues, std::size_t record_bytes) {
    return rays / records_per_chunk(record_bytes) + (rays < queues ? rays : queues) + kMostBatches;
  }

  /// Room for one more record at the end of the queue; null when the pool is empty, which chunks_needed rules out.
  std::byte* append(RayQueue& queue);
  /// Moves whole chunks out of the queue until at least `rays` are out or it is empty.
  RayQueue take(RayQueue& queue, std::uint32_t rays);
  /// Gives a queue's chunks back.
  void release(RayQueue& queue);

  /// Calls visit(record) for each record of a queue.
  template <typename Visit>
  void for_each(const RayQueue& queue, Visit&& visit) const {
    for (std::uint32_t chunk = queue.head; chunk != kNoChunk; chunk = header(chunk).next) {
      for (std::uint32_t i = 0; i < header(chunk).count; ++i) {
        visit(records(chunk) + i * record_bytes_);
      }
    }
  }

 private:
  struct ChunkHeader {
    std::uint32_t next;
    std::uint32_t count;
  };
  RayPool(std::size_t record_bytes, std::uint32_t chunk_count)
      : record_bytes_(record_bytes), chunk_count_(chunk_count) {}
  [[nodiscard]] ChunkHeader& header(std::uint32_t chunk) const {
    return *reinterpret_cast<ChunkHeader*>(arena_.data() + std::size_t(chunk) * kRayChunkBytes);
  }
  [[nodiscard]] std::byte* records(std::uint32_t chunk) const {
    return arena_.data() + std::size_t(chunk) * kRayChunkBytes + sizeof(ChunkHeader);
  }

  const std::size_t record_bytes_;
  const std::uint32_t chunk_count_;
  storage::BudgetReservation reservation_;
  storage::MappedMemory arena_;
  std::uint32_t free_head_ = kNoChunk;
  std::uint32_t never_used_ = 0;  // chunks from here on were never given out: their memory is not touched yet
};

}  // namespace raymill::traversal
