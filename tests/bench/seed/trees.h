// Trees: one binary SAH tree in the layouts that the algorithms walk: nodes of 2, 4, 8 and 16 child boxes, nodes of one
// box with a skip pointer, nodes of one box with a parent pointer. All have the same leaves over the same triangles.
//
// Boxes are float32 and exact unions; a child reference is a node's index or a leaf. Immutable once built.
#pragma once

#include <array>
#include <cstdint>
#include <tuple>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/build/binary_tree.h"

namespace raymill::bench {

/// A leaf: bit 31, in bits 28 to 30 one less than its triangles, below them the first one. Else the index of a node.
constexpr std::uint32_t kLeafBit = 1U << 31;
constexpr unsigned kLeafCountShift = 28;
constexpr std::uint32_t kMostTriangles = 1U << kLeafCountShift;
constexpr bool is_leaf(std::uint32_t reference) { return (reference & kLeafBit) != 0; }
constexpr std::uint32_t leaf_first(std::uint32_t reference) { return reference & (kMostTriangles - 1); }
constexpr std::uint32_t leaf_count(std::uint32_t reference) { return (reference >> kLeafCountShift & 7) + 1; }
constexpr std::uint32_t leaf_of(std::uint32_t first, std::uint32_t count) {
  return kLeafBit | (count - 1) << kLeafCountShift | first;
}
constexpr std::uint32_t kNoReference = 0xFFFFFFFFU;

constexpr std::size_t kLineBytes = 64;

/// What a traversal with a stack needs of a node. An empty slot has a box that no ray meets.
template <unsigned N>
struct alignas(kLineBytes) NodeWithoutLinks {
  std::array<std::array<float, N>, 6> planes;  ///< row 2 * axis: lower; the next row: upper
  std::array<std::uint32_t, N> child;
};

/// The same with the links of the stackless traversal, which stand where alignment leaves 4 N bytes free: Afra &
/// Szirmay-Kalos 2014 keep them in the padding of their nodes too. sibling[i] is the child of the parent that stands
/// i + 1 slots after this node, counted in a circle; it may be a leaf. The root is its own parent.
template <unsigned N>
struct alignas(kLineBytes) Node {
  std::array<std::array<float, N>, 6> planes;
  std::array<std::uint32_t, N> child;
  std::array<std::uint32_t, N - 1> sibling;
  std::uint32_t parent;
};
static_assert(sizeof(Node<2>) == sizeof(NodeWithoutLinks<2>) && sizeof(Node<2>) == 64);
static_assert(sizeof(Node<4>) == sizeof(NodeWithoutLinks<4>) && sizeof(Node<4>) == 128);
static_assert(sizeof(Node<8>) == sizeof(NodeWithoutLinks<8>) && sizeof(Node<8>) == 256);
// Seven lines are full without links: for N = 16 they take the eighth. The stack walks the node of eight lines as well.
static_assert(sizeof(Node<16>) == 512 && sizeof(NodeWithoutLinks<16>) == 448);

template <unsigned N>
struct WideTree {
  std::vector<Node<N>> nodes;  ///< nodes[0] is the root; depth first
  unsigned levels = 0;         ///< of nodes; leaves do not count
};

/// Depth first, so that a node's first child is the next node; `skip` is the node after its last descendant (Smits
/// 1998).
struct SkipNode {
  std::array<float, 6> planes;
  std::uint32_t skip;
  std::uint32_t leaf;  ///< 0: an inner node
};

/// The root is node 0, siblings differ in the lowest bit of their index.
struct LinkedNode {
  std::array<float, 6> planes;
  std::uint32_t child;            ///< the lower child along the axis; or a leaf
  std::uint32_t parent_and_axis;  ///< the parent's index times four; the axis along which the children stand apart

  [[nodiscard]] std::uint32_t parent() const { return parent_and_axis >> 2; }
  [[nodiscard]] unsigned axis() const { return parent_and_axis & 3; }
};
static_assert(sizeof(SkipNode) == 32 && sizeof(LinkedNode) == 32);

struct Trees {
  std::vector<std::array<std::array<float, 3>, 3>> triangles;  ///< corners, in leaf order
  std::tuple<WideTree<2>, WideTree<4>, WideTree<8>, WideTree<16>> wide;
  std::vector<SkipNode> skip_nodes;
  std::vector<LinkedNode> linked_nodes;

  template <unsigned N>
  [[nodiscard]] const WideTree<N>& of_width() const {
    return std::get<WideTree<N>>(wide);
  }
};

/// Errors: unsupported (too few triangles for an inner node, too many, or a tree deeper than a bitstack or a trail
/// holds), and the builder's.
Result<Trees> build_trees(std::vector<storage::Triangle> triangles);

}  // namespace raymill::bench
