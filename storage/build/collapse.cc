#include "storage/build/collapse.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <limits>
#include <span>

#include "storage/build/wide_node_order.h"

namespace raymill::storage {

unsigned balanced_levels(std::uint64_t count, unsigned width, unsigned per_leaf) {
  unsigned levels = 1;
  for (std::uint64_t capacity = std::uint64_t(width) * per_leaf; capacity < count; capacity *= width) {
    ++levels;
  }
  return levels;
}

double WideTree::area_cost() const {
  double cost = 0;
  for (const WideNode& node : nodes) {
    for (unsigned slot = 0; slot < width; ++slot) {
      if (node.has(slot)) {
        cost += node.boxes[slot].half_area() * (node.is_leaf(slot) ? node.count[slot] : 1);
      }
    }
  }
  return cost;
}

double WideTree::sah_cost() const {
  const double root_area = bounds.half_area();
  return root_area > 0 ? (root_area + area_cost()) / root_area : 0;
}

namespace {

// A subtree yet to be placed: a binary node, or a plain range of triangles that is to be built balanced.
struct Piece {
  Aabb box;
  std::uint32_t first = 0;  // triangle range
  std::uint32_t count = 0;
  std::uint32_t binary = kBalanced;
  bool can_open = false;  // an inner node of the binary tree
  double half_area = 0;   // where it can be opened
  static constexpr std::uint32_t kBalanced = std::numeric_limits<std::uint32_t>::max();
};

// The children-to-be of one wide node.
struct Pieces {
  std::array<Piece, kMaxWidth> items;
  std::size_t count = 0;

  void add(const Piece& piece) { items[count++] = piece; }
  void replace(std::size_t i, const Piece& left, const Piece& right) {
    std::copy_backward(items.begin() + static_cast<std::ptrdiff_t>(i) + 1,
                       items.begin() + static_cast<std::ptrdiff_t>(count),
                       items.begin() + static_cast<std::ptrdiff_t>(count) + 1);
    items[i] = left;
    items[i + 1] = right;
    ++count;
  }
  [[nodiscard]] std::span<const Piece> span() const { return std::span(items).first(count); }
};

// What a tree's leaves hold. A leaf of triangles stands in its node; a run is a tree of its own.
template <std::uint32_t kTriangles>
struct TriangleUnits {
  static constexpr std::uint32_t kPerLeaf = kTriangles;
  static constexpr bool kOuter = false;
  const std::vector<Triangle>& triangles;
  [[nodiscard]] Aabb box(std::uint32_t i) const { return bounds(triangles[i]); }
};
struct RunUnits {
  static constexpr std::uint32_t kPerLeaf = 1;
  static constexpr bool kOuter = true;
  const std::vector<Aabb>& boxes;
  [[nodiscard]] Aabb box(std::uint32_t i) const { return boxes[i]; }
};

template <typename Units>
class Collapser {
 public:
  Collapser(const BinaryTree& binary, Units units, WideTree& tree, LevelRange range)
      : binary_(binary), units_(units), tree_(tree), range_(range), first_(binary.nodes.size()), count_(first_.size()) {
    // Children follow their parents, so one sweep from the back sums the ranges.
    for (std::size_t i = binary.nodes.size(); i-- > 0;) {
      const BinaryNode& node = binary.nodes[i];
      first_[i] = node.count > 0 ? node.left : first_[node.left];
      count_[i] = node.count > 0 ? node.count : count_[node.left] + count_[node.right];
    }
  }

  void run() {
    // Depth first with an explicit stack: adversarial scenes make deep trees.
    std::vector<Pending> stack{{piece_of(0), 0, 0, range_.first}};
    while (!stack.empty()) {
      const Pending pending = stack.back();
      stack.pop_back();
      const auto index = static_cast<std::uint32_t>(tree_.nodes.size());
      tree_.nodes.emplace_back();
      if (index > 0) {
        tree_.nodes[pending.parent].child[pending.slot] = index;
      }
      place_children(index, pending, stack);
    }
  }

 private:
  struct Pending {
    Piece piece;
    std::uint32_t parent;
    unsigned slot;
    unsigned level;
  };

  [[nodiscard]] Piece piece_of(std::uint32_t binary) const {
    const BinaryNode& node = binary_.nodes[binary];
    const bool can_open = node.count == 0;
    return {node.box, first_[binary], count_[binary], binary, can_open, can_open ? node.box.half_area() : 0};
  }

  [[nodiscard]] Piece range_piece(std::uint32_t first, std::uint32_t count) const {
    Piece piece;
    piece.first = first;
    piece.count = count;
    for (std::uint32_t i = first; i < first + count; ++i) {
      piece.box.grow(units_.box(i));
    }
    return piece;
  }

  // The pieces under one wide node, by opening the largest until `width` stand.
  Pieces open_largest(const Piece& piece) const {
    Pieces pieces;
    pieces.add(piece);
    while (pieces.count < tree_.width) {
      std::size_t best = pieces.count;
      for (std::size_t i = 0; i < pieces.count; ++i) {
        if (pieces.items[i].can_open &&
            (best == pieces.count || pieces.items[i].half_area > pieces.items[best].half_area)) {
          best = i;
        }
      }
      if (best == pieces.count) {
        break;
      }
      const BinaryNode& node = binary_.nodes[pieces.items[best].binary];
      pieces.replace(best, piece_of(node.left), piece_of(node.right));
    }
    return pieces;
  }

  // Equal shares of the range, each within what `levels_left` levels below can hold.
  Pieces split_balanced(const Piece& piece, unsigned levels_left) const {
    std::uint64_t capacity = Units::kPerLeaf;
    for (unsigned i = 0; i < levels_left && capacity < piece.count; ++i) {
      capacity *= tree_.width;
    }
    const auto parts = static_cast<std::uint32_t>(std::clamp<std::uint64_t>(
        (piece.count + capacity - 1) / capacity, std::min<std::uint64_t>(piece.count, 2), tree_.width));
    Pieces pieces;
    for (std::uint32_t i = 0; i < parts; ++i) {
      const auto begin = static_cast<std::uint32_t>(std::uint64_t(piece.count) * i / parts);
      const auto end = static_cast<std::uint32_t>(std::uint64_t(piece.count) * (i + 1) / parts);
      pieces.add(range_piece(piece.first + begin, end - begin));
    }
    return pieces;
  }

  void place_children(std::uint32_t index, const Pending& pending, std::vector<Pending>& stack) {
    const unsigned levels_left = range_.limit - pending.level;  // this node's level included
    const bool balanced = pending.piece.binary == Piece::kBalanced ||
                          balanced_levels(pending.piece.count, tree_.width, Units::kPerLeaf) >= levels_left;
    const Pieces pieces = balanced ? split_balanced(pending.piece, levels_left - 1) : open_largest(pending.piece);

    WideNode node;
    node.parent = pending.parent;
    node.level = static_cast<std::uint8_t>(pending.level);
    tree_.levels = std::max(tree_.levels, pending.level + 1);
    std::array<Aabb, kMaxWidth> boxes;
    std::transform(pieces.span().begin(), pieces.span().end(), boxes.begin(), [](const Piece& p) { return p.box; });
    const std::array<unsigned, kMaxWidth> slots =
        assign_slots(std::span(boxes).first(pieces.count), pending.piece.box, tree_.width, node.order);
    for (std::size_t i = 0; i < pieces.count; ++i) {
      const unsigned slot = slots[i];
      const Piece& piece = pieces.items[i];
      node.valid = static_cast<std::uint8_t>(node.valid | 1U << slot);
      node.boxes[slot] = piece.box;
      const bool leaf = piece.count <= Units::kPerLeaf && !piece.can_open;
      if (leaf) {
        node.child[slot] = piece.first;
        node.count[slot] = static_cast<std::uint8_t>(Units::kOuter ? 0 : piece.count);
        node.outer = static_cast<std::uint8_t>(node.outer | (Units::kOuter ? 1U << slot : 0U));
      } else {
        assert(pending.level + 1 < range_.limit);
        stack.push_back({piece, index, slot, pending.level + 1});
      }
    }
    tree_.nodes[index] = node;
    std::reverse(stack.end() - static_cast<std::ptrdiff_t>(inner_count(node)), stack.end());
  }

  [[nodiscard]] unsigned inner_count(const WideNode& node) const {
    unsigned inner = 0;
    for (unsigned slot = 0; slot < tree_.width; ++slot) {
      inner += node.is_inner(slot) ? 1 : 0;
    }
    return inner;
  }

  const BinaryTree& binary_;
  const Units units_;
  WideTree& tree_;
  const LevelRange range_;
  std::vector<std::uint32_t> first_;
  std::vector<std::uint32_t> count_;
};

template <std::uint32_t kPerLeaf>
WideTree collapse_triangles(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width,
                            LevelRange range) {
  assert(range.first + balanced_levels(triangles.size(), width, kPerLeaf) <= range.limit);
  WideTree tree;
  tree.width = width;
  tree.triangles = std::move(triangles);
  tree.bounds = binary.nodes[0].box;
  Collapser<TriangleUnits<kPerLeaf>>(binary, {tree.triangles}, tree, range).run();
  return tree;
}

}  // namespace

WideTree collapse(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width, LevelRange range) {
  return collapse_triangles<kMaxLeafTriangles>(binary, std::move(triangles), width, range);
}

WideTree collapse_single(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width, LevelRange range) {
  return collapse_triangles<1>(binary, std::move(triangles), width, range);
}

WideTree collapse_over_runs(const BinaryTree& binary, const std::vector<Aabb>& run_boxes, unsigned width,
                            LevelRange range) {
  assert(range.first + balanced_levels(run_boxes.size(), width, 1) <= range.limit);
  WideTree tree;
  tree.width = width;
  tree.bounds = binary.nodes[0].box;
  Collapser<RunUnits>(binary, {run_boxes}, tree, range).run();
  return tree;
}

}  // namespace raymill::storage
