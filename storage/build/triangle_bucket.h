// TriangleBucket: a list of triangles of any length, in blocks. BucketWriter appends to one.
//
// Triangles come back in the order in which they went in. Thread-confined; buckets of one BlockStore may be read in
// different threads.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/status.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

constexpr std::size_t kBlockTriangles = kBlockBytes / sizeof(Triangle);

/// Half of lower plus half of upper: cannot overflow, and orders triangles as the middle of their boxes does.
inline Vec3f middle(const Aabb& box) {
  return {box.lower.x * 0.5F + box.upper.x * 0.5F, box.lower.y * 0.5F + box.upper.y * 0.5F,
          box.lower.z * 0.5F + box.upper.z * 0.5F};
}

struct TriangleBucket {
  std::vector<BlockId> blocks;  ///< all full but the last
  std::uint64_t count = 0;
  Aabb box;
  Aabb middles;  ///< of the triangles' boxes

  void note(const Aabb& of_t) {
    box.grow(of_t);
    middles.grow(middle(of_t));
    ++count;
  }
  [[nodiscard]] std::size_t in_block(std::size_t block) const {
    return static_cast<std::size_t>(std::min<std::uint64_t>(kBlockTriangles, count - block * kBlockTriangles));
  }
};

class BucketWriter {
 public:
  explicit BucketWriter(BlockStore& store) : store_(store) {}
  /// Memory that a writer holds.
  static constexpr std::uint64_t bytes() { return kBlockBytes; }

  /// Errors: disk_full, io.
  Status add(const Triangle& t) { return add(t, bounds(t)); }
  /// The same where the triangle's bounds are known.
  Status add(const Triangle& t, const Aabb& box) {
    buffer_.reserve(kBlockTriangles);
    bucket_.note(box);
    buffer_.push_back(t);
    return buffer_.size() == kBlockTriangles ? flush() : Status();
  }
  /// What was added; the writer is empty after it. Errors: disk_full, io.
  Result<TriangleBucket> take();

 private:
  Status flush();
  BlockStore& store_;
  TriangleBucket bucket_;
  std::vector<Triangle> buffer_;
};

/// Fills `triangles` with all of a bucket; its blocks are freed. Errors: io.
Status load(BlockStore& store, const TriangleBucket& bucket, std::vector<Triangle>& triangles);

}  // namespace raymill::storage
