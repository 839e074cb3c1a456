// Partition: the triangles of a scene cut in space into runs that are built one by one.
//
//   bucket --count cells--> CellGrid --SAH--> tree over runs
//      |                                        |
//      +------------- distribute ---------------+--> a bucket for each run; a part that is still too large: again
//
// Only counts are held in memory, never the scene. How often triangles are copied depends on how many buckets may be
// open at once; what comes out depends on the triangles and their order alone. Thread-confined.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/status.h"
#include "storage/base/types.h"
#include "storage/build/lattice.h"
#include "storage/build/triangle_bucket.h"

namespace raymill::storage {

/// Triangles of a run: bounds the memory of its build, and small enough that many cores share a scene of millions.
constexpr std::uint64_t kRunTriangles = 1u << 18;

/// A binary tree over runs. Nodes stand parents first, and the runs below a node follow each other.
struct PartitionNode {
  Aabb box;
  std::uint64_t count = 0;            ///< triangles
  std::uint32_t left = 0, right = 0;  ///< 0: a leaf
  std::uint32_t first_run = 0, run_count = 0;
  [[nodiscard]] bool is_leaf() const { return left == 0; }
};

struct Partition {
  std::vector<PartitionNode> nodes;      ///< nodes[0] is the root; none: no triangles
  std::vector<TriangleBucket> runs;      ///< depth first
  std::uint32_t first_instances = ~0U;   ///< runs from this one on hold instances, each a triangle with its box
  std::uint64_t dropped_degenerate = 0;  ///< that the lattice made so
  [[nodiscard]] bool holds_instances(std::size_t run) const { return run >= first_instances; }
};

/// Both under one root. `instances`: triangles that stand for instances.
Partition join(Partition triangles, Partition instances);

struct PartitionConfig {
  std::uint64_t run_triangles = kRunTriangles;
  std::uint32_t most_open_buckets = 64;  ///< at least 2; each holds BucketWriter::bytes()
  unsigned threads = 1;                  ///< what comes out does not depend on them
  /// Called now and then, from one thread at a time, with the triangles handled so far; an error ends the work.
  std::function<Status(std::uint64_t triangles)> progress;
};

/// Cuts `all`, whose blocks are freed. Corners are put on `lattice` on the way; triangles that become degenerate are
/// dropped and counted in its report. Errors: disk_full, io, invalid_argument (the lattice), progress's.
Result<Partition> partition_triangles(BlockStore& store, TriangleBucket all, Lattice& lattice,
                                      const PartitionConfig& config);

/// Memory that the call takes beside the blocks.
std::uint64_t partition_bytes(std::uint32_t most_open_buckets, unsigned threads, std::uint64_t triangle_count);

}  // namespace raymill::storage
