// WideTree: an MBVH before it is cut into pages: the tree of one run, or the top tree over the runs' roots.
//
// Invariants: triangles stand in leaf order; nodes stand depth first; each node but the root is the child of exactly
// one node with a smaller level; levels x width fits the bitstack; a child's box is the exact union of its triangles'
// boxes. Immutable once built.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "storage/base/types.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

struct WideNode {
  std::array<Aabb, kMaxWidth> boxes;
  std::array<std::uint32_t, kMaxWidth> child{};  ///< node index; first triangle of a leaf; run of an outer child
  std::array<std::uint8_t, kMaxWidth> count{};   ///< 1 to kMaxLeafTriangles: leaf; else 0
  std::uint32_t parent = 0;                      ///< node index; the root is its own parent
  std::uint8_t valid = 0;                        ///< bit for each slot that holds a child
  std::uint8_t outer = 0;                        ///< of those: the child is the root of a run's tree
  std::uint8_t level = 0;                        ///< 0 at the root of the whole scene
  std::uint8_t order = 0;                        ///< two axes of two bits: what slot bits mean for width 4

  [[nodiscard]] bool has(unsigned slot) const { return (valid >> slot & 1) != 0; }
  [[nodiscard]] bool is_leaf(unsigned slot) const { return count[slot] > 0; }
  /// A node of the same tree.
  [[nodiscard]] bool is_inner(unsigned slot) const { return ((valid & ~outer) >> slot & 1) != 0 && count[slot] == 0; }
  [[nodiscard]] bool is_outer(unsigned slot) const { return (outer >> slot & 1) != 0; }
};

/// The union of its children's boxes.
inline Aabb node_box(const WideNode& node, unsigned width) {
  Aabb all;
  for (unsigned slot = 0; slot < width; ++slot) {
    if (node.has(slot)) {
      all.grow(node.boxes[slot]);
    }
  }
  return all;
}

struct WideTree {
  unsigned width = 8;
  std::vector<WideNode> nodes;      ///< nodes[0] is the root; depth first
  std::vector<Triangle> triangles;  ///< in leaf order
  Aabb bounds;
  unsigned levels = 0;  ///< one more than the largest level of a node

  /// Sum over children of half their box's area: once for a node visit, or once for each triangle of a leaf.
  [[nodiscard]] double area_cost() const;
  /// Surface-area cost relative to the root: 1 for a node visit, 1 for a triangle test.
  [[nodiscard]] double sah_cost() const;
};

}  // namespace raymill::storage
