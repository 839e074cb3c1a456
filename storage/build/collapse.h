// Collapse: a binary SAH tree becomes an MBVH whose depth the bitstack can hold.
#pragma once

#include <vector>

#include "storage/build/binary_tree.h"
#include "storage/build/wide_tree.h"

namespace raymill::storage {

/// Levels that a tree may take: first <= level < limit.
struct LevelRange {
  unsigned first = 0;
  unsigned limit = 0;
};

/// Opens, node by node, the child of largest area until `width` children stand (FACTS: fills nodes as well as a wide
/// build). Depth guarantee for any input: as soon as a subtree has just enough levels left for a balanced tree over
/// its triangles, it is built balanced, by the median of the leaf order.
/// `range`: at least balanced_levels() of all triangles.
WideTree collapse(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width, LevelRange range);

/// The same with one triangle to a leaf.
WideTree collapse_single(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width, LevelRange range);

/// The same over runs: a leaf of `binary` is one run, whose tree hangs in its place as an outer child.
WideTree collapse_over_runs(const BinaryTree& binary, const std::vector<Aabb>& run_boxes, unsigned width,
                            LevelRange range);

/// Levels of a balanced tree: the least l with width^l * per_leaf >= count, at least 1.
unsigned balanced_levels(std::uint64_t count, unsigned width, unsigned per_leaf = kMaxLeafTriangles);

}  // namespace raymill::storage
