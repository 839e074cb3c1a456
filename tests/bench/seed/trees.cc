#include "tests/bench/seed/trees.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "tests/bench/seed/states.h"

namespace raymill::bench {
namespace {

using storage::Aabb;
using storage::BinaryNode;
using storage::BinaryTree;

std::array<float, 6> planes_of(const Aabb& box) {
  return {box.lower.x, box.upper.x, box.lower.y, box.upper.y, box.lower.z, box.upper.z};
}

// Opens, node by node, the child of largest area until N stand.
template <unsigned N>
class Collapser {
 public:
  Collapser(const BinaryTree& binary, WideTree<N>& tree) : binary_(binary), tree_(tree) {}

  void run() {
    // Depth first with an explicit stack: adversarial scenes make deep trees.
    std::vector<Pending> stack{{0, 0, 0, 0}};
    while (!stack.empty()) {
      const Pending pending = stack.back();
      stack.pop_back();
      const auto index = static_cast<std::uint32_t>(tree_.nodes.size());
      tree_.nodes.push_back(empty_node());
      tree_.nodes[index].parent = pending.parent;
      tree_.levels = std::max(tree_.levels, pending.level + 1);
      if (index > 0) {
        tree_.nodes[pending.parent].child[pending.slot] = index;
      }
      place_children(index, pending, stack);
    }
    link_siblings();
  }

 private:
  struct Pending {
    std::uint32_t binary;
    std::uint32_t parent;
    unsigned slot;
    unsigned level;
  };

  static Node<N> empty_node() {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    Node<N> node;
    for (unsigned row = 0; row < 6; ++row) {
      node.planes[row].fill(row % 2 == 0 ? kInfinity : -kInfinity);
    }
    node.child.fill(kNoReference);
    node.sibling.fill(kNoReference);
    return node;
  }

  [[nodiscard]] std::vector<std::uint32_t> open_largest(std::uint32_t binary) const {
    std::vector<std::uint32_t> pieces{binary};
    const auto area = [&](std::uint32_t piece) {
      const BinaryNode& node = binary_.nodes[piece];
      return node.count == 0 ? node.box.half_area() : -1;
    };
    while (pieces.size() < N) {
      const auto largest = std::max_element(pieces.begin(), pieces.end(),
                                            [&](std::uint32_t a, std::uint32_t b) { return area(a) < area(b); });
      const BinaryNode& node = binary_.nodes[*largest];
      if (node.count > 0) {
        break;
      }
      *largest = node.left;
      pieces.insert(largest + 1, node.right);
    }
    return pieces;
  }

  void place_children(std::uint32_t index, const Pending& pending, std::vector<Pending>& stack) {
    const std::vector<std::uint32_t> pieces = open_largest(pending.binary);
    for (auto slot = static_cast<unsigned>(pieces.size()); slot-- > 0;) {
      const BinaryNode& piece = binary_.nodes[pieces[slot]];
      const std::array<float, 6> planes = planes_of(piece.box);
      for (unsigned row = 0; row < 6; ++row) {
        tree_.nodes[index].planes[row][slot] = planes[row];
      }
      if (piece.count > 0) {
        tree_.nodes[index].child[slot] = leaf_of(piece.left, piece.count);
      } else {
        stack.push_back({pieces[slot], index, slot, pending.level + 1});
      }
    }
  }

  void link_siblings() {
    for (const Node<N>& node : tree_.nodes) {
      for (unsigned slot = 0; slot < N; ++slot) {
        if (is_leaf(node.child[slot])) {  // kNoReference too
          continue;
        }
        for (unsigned i = 0; i + 1 < N; ++i) {
          tree_.nodes[node.child[slot]].sibling[i] = node.child[(slot + i + 1) % N];
        }
      }
    }
  }

  const BinaryTree& binary_;
  WideTree<N>& tree_;
};

template <unsigned N>
Status collapse(const BinaryTree& binary, Trees& trees) {
  auto& tree = std::get<WideTree<N>>(trees.wide);
  Collapser<N>(binary, tree).run();
  if (tree.levels > kMostLevels<N>) {
    return {ErrorCode::unsupported, "the tree of width " + std::to_string(N) + " has " + std::to_string(tree.levels) +
                                        " levels, its bitstack holds " + std::to_string(kMostLevels<N>)};
  }
  return {};
}

// The binary tree stands depth first already, left child first.
std::vector<SkipNode> skip_nodes_of(const BinaryTree& binary) {
  std::vector<SkipNode> nodes(binary.nodes.size());
  for (auto i = static_cast<std::uint32_t>(nodes.size()); i-- > 0;) {
    const BinaryNode& from = binary.nodes[i];
    nodes[i].planes = planes_of(from.box);
    nodes[i].skip = from.count > 0 ? i + 1 : nodes[from.right].skip;
    nodes[i].leaf = from.count > 0 ? leaf_of(from.left, from.count) : 0;
  }
  return nodes;
}

float center(const Aabb& box, int axis) { return box.lower[axis] * 0.5F + box.upper[axis] * 0.5F; }

// The axis along which the children's centers are farthest apart.
int axis_of(const Aabb& left, const Aabb& right) {
  int best = 0;
  const auto distance = [&](int axis) { return std::fabs(center(left, axis) - center(right, axis)); };
  for (int axis = 1; axis < 3; ++axis) {
    best = distance(axis) > distance(best) ? axis : best;
  }
  return best;
}

std::vector<LinkedNode> linked_nodes_of(const BinaryTree& binary) {
  struct Pending {
    std::uint32_t binary, place, parent;
  };
  std::vector<LinkedNode> nodes(2);  // the root has no sibling: place 1 stays empty
  std::vector<Pending> stack{{0, 0, 0}};
  while (!stack.empty()) {
    const Pending pending = stack.back();
    stack.pop_back();
    const BinaryNode& from = binary.nodes[pending.binary];
    LinkedNode node{planes_of(from.box), 0, pending.parent << 2};
    if (from.count > 0) {
      node.child = leaf_of(from.left, from.count);
    } else {
      const Aabb &left = binary.nodes[from.left].box, &right = binary.nodes[from.right].box;
      const int axis = axis_of(left, right);
      const bool is_swapped = center(left, axis) > center(right, axis);
      node.child = static_cast<std::uint32_t>(nodes.size());
      node.parent_and_axis |= static_cast<std::uint32_t>(axis);
      nodes.resize(nodes.size() + 2);
      stack.push_back({is_swapped ? from.left : from.right, node.child + 1, pending.place});
      stack.push_back({is_swapped ? from.right : from.left, node.child, pending.place});
    }
    nodes[pending.place] = node;
  }
  return nodes;
}

}  // namespace

Result<Trees> build_trees(std::vector<storage::Triangle> triangles) {
  if (triangles.size() >= kMostTriangles) {
    return {ErrorCode::unsupported, "a leaf's reference counts to " + std::to_string(kMostTriangles) + " triangles"};
  }
  RAYMILL_ASSIGN_OR_RETURN(const auto device, storage::EmbreeDevice::create());
  BinaryTree binary;
  RAYMILL_RETURN_IF_ERROR(storage::BinaryTreeBuilder(device).build(triangles, binary));
  if (binary.nodes[0].count > 0) {
    return {ErrorCode::unsupported, "the scene fits a single leaf: there is nothing to traverse"};
  }
  Trees trees;
  trees.triangles.reserve(triangles.size());
  for (const storage::Triangle& triangle : triangles) {
    auto& corners = trees.triangles.emplace_back();
    for (unsigned i = 0; i < 3; ++i) {
      corners[i] = {triangle.v[i].x, triangle.v[i].y, triangle.v[i].z};
    }
  }
  RAYMILL_RETURN_IF_ERROR(collapse<2>(binary, trees));
  if (trees.of_width<2>().levels > kMostTrailLevels) {
    return {ErrorCode::unsupported,
            "the tree has more than the " + std::to_string(kMostTrailLevels) + " levels that a restart trail holds"};
  }
  RAYMILL_RETURN_IF_ERROR(collapse<4>(binary, trees));
  RAYMILL_RETURN_IF_ERROR(collapse<8>(binary, trees));
  RAYMILL_RETURN_IF_ERROR(collapse<16>(binary, trees));
  trees.skip_nodes = skip_nodes_of(binary);
  trees.linked_nodes = linked_nodes_of(binary);
  return trees;
}

}  // namespace raymill::bench
