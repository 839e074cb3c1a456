// Collapse: the binary SAH tree becomes the MBVH whose depth the bitstack can hold.
#pragma once

#include <vector>

#include "storage/build/binary_tree.h"
#include "storage/build/wide_tree.h"

namespace raymill::storage {

/// Opens, node by node, the child of largest area until `width` children stand (FACTS: fills nodes as well as a wide
/// build). Depth guarantee for any input: as soon as a subtree has just enough levels left for a balanced tree over
/// its triangles, it is built balanced, by the median of the leaf order.
/// Children go to the slots whose order, under XOR with a ray's octant, is front to back (Ylitie, Karras, Laine 2017,
/// section 3.2; greedy instead of the auction).
/// `level_limit`: levels that the tree may have, at least balanced_levels() of all triangles.
WideTree collapse(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width, unsigned level_limit);

/// Levels of a balanced tree: the least l with width^l * kMaxLeafTriangles >= triangle_count, at least 1.
unsigned balanced_levels(std::uint64_t triangle_count, unsigned width);

}  // namespace raymill::storage
