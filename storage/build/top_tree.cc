#include "storage/build/top_tree.h"

#include <algorithm>

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

unsigned levels_of_runs(const Partition& partition, unsigned width) {
  unsigned levels = 1;
  for (std::size_t run = 0; run < partition.runs.size(); ++run) {
    const unsigned per_leaf = partition.holds_instances(run) ? 1 : kMaxLeafTriangles;
    levels = std::max(levels, balanced_levels(partition.runs[run].count, width, per_leaf));
  }
  return levels;
}

unsigned levels_over_runs(const Partition& partition, unsigned width) {
  return partition.runs.size() > 1 ? balanced_levels(partition.runs.size(), width, 1) : 0;
}

}  // namespace

unsigned least_levels(const Partition& partition, unsigned width) {
  return levels_over_runs(partition, width) + levels_of_runs(partition, width);
}

TopTree build_top_tree(const Partition& partition, unsigned width, LevelRange levels) {
  TopTree top;
  top.tree.width = width;
  top.places.resize(partition.runs.size(), {0, levels});
  if (partition.runs.size() == 1) {
    return top;
  }
  const unsigned below = levels_of_runs(partition, width) + spare_levels(width);
  const unsigned top_limit =
      std::max(levels.first + levels_over_runs(partition, width), levels.limit - std::min(levels.limit, below));
  std::vector<Aabb> boxes;
  for (const TriangleBucket& run : partition.runs) {
    boxes.push_back(run.box);
  }
  top.tree = collapse_over_runs(binary_of(partition), boxes, width, {levels.first, top_limit});
  for (std::uint32_t i = 0; i < top.tree.nodes.size(); ++i) {
    const WideNode& node = top.tree.nodes[i];
    for (unsigned slot = 0; slot < width; ++slot) {
      if (node.is_outer(slot)) {
        top.places[node.child[slot]] = {i, {node.level + 1U, levels.limit}};
      }
    }
  }
  return top;
}

}  // namespace raymill::storage
