// BinaryTree: a SAH BVH over all triangles; the first stage of the build.
//
// The scene is partitioned from the top by binned SAH into runs of at most kRunTriangles, and each run is built by
// Embree's SAH builder on one thread, several runs at once. What a run becomes depends on its triangles alone, so the
// tree is the same whatever the number of threads.
#pragma once

#include <cstdint>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

struct BinaryNode {
  Aabb box;
  std::uint32_t left = 0;   ///< node index; for a leaf the first triangle
  std::uint32_t right = 0;  ///< node index; unused in a leaf
  std::uint32_t count = 0;  ///< triangles of a leaf, 0 for an inner node
};

struct BinaryTree {
  std::vector<BinaryNode> nodes;  ///< nodes[0] is the root
};

/// Triangles of one Embree build: bounds the builder's own memory, and small enough that two cores share a scene of
/// a million.
constexpr std::uint32_t kRunTriangles = 1u << 18;

/// Builds the tree and puts `triangles` into leaf order. `threads` 0: all cores.
/// Errors: budget_exceeded, internal (Embree refused).
Result<BinaryTree> build_binary_tree(std::vector<Triangle>& triangles, unsigned threads, Ledger& ledger);

/// Memory that build_binary_tree claims beyond the triangles themselves.
std::uint64_t binary_tree_build_bytes(std::uint64_t triangle_count, unsigned threads);

}  // namespace raymill::storage
