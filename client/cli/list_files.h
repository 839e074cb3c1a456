// ListFiles: where trace's lists of hits or spans go, as a compressed sparse row matrix: those of ray i are the rows
// offsets[i] to offsets[i + 1] of the hits file.
//
//   HITS.npy          structured rows, as of the other queries
//   HITS.offsets.npy  uint64, one more than rays
//
// Both are written as a stream; how many hits there are stands in the header of the hits, which is written last. A
// temporary name each, and renamed when whole (AtomicFile). Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "storage/base/atomic_file.h"
#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::client {

class ListFiles {
 public:
  /// Errors: those of AtomicFile; invalid_argument (not a plain file: the header is written last).
  static Result<ListFiles> create(const std::string& hits_path, const HitLayout& layout, std::uint64_t ray_count);
  /// "hits.npy" -> "hits.offsets.npy".
  static std::string offsets_path(const std::string& hits_path);

  /// Rays whose hits are all written.
  [[nodiscard]] std::uint64_t rays_done() const { return rays_done_; }
  [[nodiscard]] std::uint64_t hits() const { return hits_; }
  Status write(const HitChunk& chunk);
  /// The outputs get their names.
  Status commit();

 private:
  ListFiles(storage::AtomicFile hits, storage::AtomicFile offsets, const HitLayout& layout)
      : hits_file_(std::move(hits)), offsets_file_(std::move(offsets)), layout_(layout) {}

  storage::AtomicFile hits_file_, offsets_file_;
  HitLayout layout_;
  std::size_t header_bytes_ = 0;
  std::uint64_t rays_done_ = 0;
  std::uint64_t hits_ = 0;
  std::vector<std::uint64_t> ends_;  // of the rays of a chunk
};

}  // namespace raymill::client
