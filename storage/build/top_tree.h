// TopTree: the MBVH over the roots of all runs, and where each run hangs in it.
#pragma once

#include <cstdint>
#include <vector>

#include "storage/base/status.h"
#include "storage/build/collapse.h"
#include "storage/build/partition.h"
#include "storage/build/wide_tree.h"

namespace raymill::storage {

struct TopTree {
  WideTree tree;  ///< no nodes where there is one run
  struct Place {
    std::uint32_t parent = 0;  ///< node of `tree`; unused where that has none
    LevelRange levels;         ///< that the run's own tree may take
  };
  std::vector<Place> places;  ///< [run]
};

/// Leaves each run a few levels more than a balanced tree over its triangles needs.
/// `levels`: at least least_levels().
TopTree build_top_tree(const Partition& partition, unsigned width, LevelRange levels);

/// Levels of a balanced tree over all runs.
unsigned least_levels(const Partition& partition, unsigned width);

}  // namespace raymill::storage
