// RayPool: where rays wait in memory. Queues of records in small chunks from one arena, first in, first out.
//
//   RayQueue: head -> chunk -> chunk -> tail      chunk: next, rays, bytes, records one after the other
//
// A chunk is small because most pages have few rays waiting: half a chunk a queue is what containers waste.
// Thread-compatible: the owner's lock guards it; records of chunks taken out may be read without.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

constexpr std::uint32_t kNoChunk = 0xFFFFFFFFu;
constexpr std::size_t kRayChunkBytes = 512;

struct RayQueue {
  std::uint32_t head = kNoChunk;
  std::uint32_t tail = kNoChunk;
  std::uint32_t count = 0;  ///< rays
};

class RayPool {
 public:
  /// Claims chunk_count * kRayChunkBytes (Tag::rays). Errors: budget_exceeded.
  static Result<std::unique_ptr<RayPool>> create(RecordLayout layout, std::uint32_t chunk_count,
                                                 storage::Ledger& ledger);
  RayPool(const RayPool&) = delete;
  RayPool& operator=(const RayPool&) = delete;

  /// Records of at most so many bytes that a chunk surely holds.
  static constexpr std::size_t records_per_chunk(std::size_t record_bytes) {
    return (kRayChunkBytes - sizeof(ChunkHeader)) / record_bytes;
  }
  /// Chunks that surely hold records of so many bytes, each of at most `record_bytes`, spread over so many queues.
  static constexpr std::uint64_t chunks_for(std::uint64_t bytes, std::uint64_t queues, std::size_t record_bytes) {
    return bytes / (kRayChunkBytes - sizeof(ChunkHeader) - record_bytes) + queues;
  }

  [[nodiscard]] const RecordLayout& layout() const { return layout_; }
  [[nodiscard]] std::uint32_t free_chunks() const { return free_count_; }
  [[nodiscard]] std::uint32_t chunk_count() const { return chunk_count_; }

  /// Room for a record more at the end of the queue; null when the pool is empty.
  std::byte* append(RayQueue& queue, std::size_t record_bytes);
  /// Moves whole chunks out of the queue until at least `rays` are out or it is empty.
  RayQueue take(RayQueue& queue, std::uint32_t rays);
  /// Moves whole chunks out of the queue as long as their records have at most `bytes`; says how many they have.
  RayQueue take_bytes(RayQueue& queue, std::size_t bytes, std::size_t& taken_bytes);
  /// Gives a queue's chunks back.
  void release(RayQueue& queue);

  /// Calls visit(records) for each chunk of a queue: its records, one after the other.
  template <typename Visit>
  void for_each_chunk(const RayQueue& queue, Visit&& visit) const {
    for (std::uint32_t chunk = queue.head; chunk != kNoChunk; chunk = header(chunk).next) {
      visit(std::span<const std::byte>(records(chunk), header(chunk).bytes));
    }
  }
  /// Calls visit(record) for each record of a queue.
  template <typename Visit>
  void for_each(const RayQueue& queue, Visit&& visit) const {
    for_each_chunk(queue, [&](std::span<const std::byte> records) {
      for (std::size_t at = 0; at < records.size(); at += layout_.bytes(records.data() + at)) {
        visit(records.data() + at);
      }
    });
  }

 private:
  struct ChunkHeader {
    std::uint32_t next;
    std::uint16_t rays;
    std::uint16_t bytes;
  };
  RayPool(RecordLayout layout, std::uint32_t chunk_count)
      : layout_(layout), chunk_count_(chunk_count), free_count_(chunk_count) {}
  [[nodiscard]] ChunkHeader& header(std::uint32_t chunk) const {
    return *reinterpret_cast<ChunkHeader*>(arena_.data() + std::size_t(chunk) * kRayChunkBytes);
  }
  [[nodiscard]] std::byte* records(std::uint32_t chunk) const {
    return arena_.data() + std::size_t(chunk) * kRayChunkBytes + sizeof(ChunkHeader);
  }
  void move_head(RayQueue& from, RayQueue& to);

  const RecordLayout layout_;
  const std::uint32_t chunk_count_;
  storage::BudgetReservation reservation_;
  storage::MappedMemory arena_;
  std::uint32_t free_count_;
  std::uint32_t free_head_ = kNoChunk;
  std::uint32_t never_used_ = 0;  // chunks from here on were never given out: their memory is not touched yet
};

}  // namespace raymill::traversal
