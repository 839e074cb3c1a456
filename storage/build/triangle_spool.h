// TriangleSpool: a BucketWriter on a thread of its own, so that who makes triangles does not wait for the disk.
//
//   add(): pieces --> at most kPieces wait --> thread: BucketWriter --> blocks
//
// What comes out is what a BucketWriter gives for the same triangles. The thread begins with the first full piece;
// fewer triangles, and all without a thread, are written by the caller. Thread-confined beside its own thread.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <mutex>
#include <span>
#include <thread>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/status.h"
#include "storage/build/triangle_bucket.h"

namespace raymill::storage {

class TriangleSpool {
 public:
  /// `own_thread`: whether there is a second thread to write on.
  TriangleSpool(BlockStore& store, bool own_thread) : writer_(store), own_thread_(own_thread) {}
  TriangleSpool(const TriangleSpool&) = delete;
  TriangleSpool& operator=(const TriangleSpool&) = delete;
  ~TriangleSpool() { stop(); }

  /// Memory that a spool holds.
  [[nodiscard]] std::uint64_t bytes() const {
    return BucketWriter::bytes() + (own_thread_ ? (kPieces + 2) * kPieceTriangles * sizeof(Triangle) : 0);
  }

  /// Errors: disk_full, io, budget_exceeded (the machine has less memory than the budget); also those of triangles that
  /// were added before.
  Status add(std::span<const Triangle> triangles);
  /// What was added; the spool is empty after it. Errors: those of add().
  Result<TriangleBucket> take();

 private:
  using Piece = std::vector<Triangle>;
  static constexpr std::size_t kPieceTriangles = 8192;
  static constexpr std::size_t kPieces = 4;

  Status hand_over();
  Status write(std::span<const Triangle> piece);
  void run();
  void stop();

  BucketWriter writer_;
  const bool own_thread_;
  Piece filling_;
  std::thread thread_;
  std::mutex mutex_;
  std::condition_variable waiting_changed_;
  std::deque<Piece> waiting_;  // the front one is being written
  std::vector<Piece> spare_;
  Status failure_;
  bool ended_ = false;
};

}  // namespace raymill::storage
