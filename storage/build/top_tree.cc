#include "storage/build/top_tree.h"

#include <algorithm>
#include <string>

namespace raymill::storage {
namespace {

// Levels beyond those of a balanced tree, so that a run's tree can follow the SAH.
unsigned spare_levels(unsigned width) { return width == 8 ? 5 : 8; }

BinaryTree binary_of(const Partition& partition) {
  BinaryTree binary;
  for (const PartitionNode& node : partition.nodes) {
    const bool leaf = node.is_leaf();
    binary.nodes.push_back({node.box, leaf ? node.first_run : node.left, node.right, leaf ? 1U : 0U});
  }
  return binary;
}

}  // namespace

Result<TopTree> build_top_tree(const Partition& partition, unsigned width) {
  const unsigned limit = max_levels(width);
  TopTree top;
  top.tree.width = width;
  top.places.resize(partition.runs.size(), {0, {0, limit}});
  std::uint64_t largest_run = 0;
  for (const TriangleBucket& run : partition.runs) {
    largest_run = std::max(largest_run, run.count);
  }
  const unsigned run_levels = balanced_levels(largest_run, width);
  const unsigned top_levels = partition.runs.size() > 1 ? balanced_levels(partition.runs.size(), width, 1) : 0;
  if (top_levels + run_levels > limit) {
    return {ErrorCode::unsupported, std::to_string(partition.nodes[0].count) +
                                        " triangles need a tree deeper than the " + std::to_string(kBitstackBits) +
                                        "-bit bitstack holds; use --width 8"};
  }
  if (partition.runs.size() == 1) {
    return top;
  }
  const unsigned top_limit = std::max(top_levels, limit - std::min(limit, run_levels + spare_levels(width)));
  std::vector<Aabb> boxes;
  for (const TriangleBucket& run : partition.runs) {
    boxes.push_back(run.box);
  }
  top.tree = collapse_over_runs(binary_of(partition), boxes, width, top_limit);
  for (std::uint32_t i = 0; i < top.tree.nodes.size(); ++i) {
    const WideNode& node = top.tree.nodes[i];
    for (unsigned slot = 0; slot < width; ++slot) {
      if (node.is_outer(slot)) {
        top.places[node.child[slot]] = {i, {node.level + 1U, limit}};
      }
    }
  }
  return top;
}

}  // namespace raymill::storage
