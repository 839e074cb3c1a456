#include "storage/build/collapse.h"

#include <algorithm>
#include <cassert>
#include <limits>
#include <span>

namespace raymill::storage {

unsigned balanced_levels(std::uint64_t triangle_count, unsigned width) {
  unsigned levels = 1;
  for (std::uint64_t capacity = std::uint64_t(width) * kMaxLeafTriangles; capacity < triangle_count;
       capacity *= width) {
    ++levels;
  }
  return levels;
}

double WideTree::sah_cost() const {
  const double root_area = bounds.half_area();
  if (!(root_area > 0)) {
    return 0;
  }
  double cost = root_area;
  for (const WideNode& node : nodes) {
    for (unsigned slot = 0; slot < width; ++slot) {
      if (node.has(slot)) {
        cost += node.boxes[slot].half_area() * (node.is_leaf(slot) ? node.count[slot] : 1);
      }
    }
  }
  return cost / root_area;
}

namespace {

// A subtree yet to be placed: a binary node, or a plain range of triangles that is to be built balanced.
struct Piece {
  Aabb box;
  std::uint32_t first = 0;  // triangle range
  std::uint32_t count = 0;
  std::uint32_t binary = kBalanced;
  static constexpr std::uint32_t kBalanced = std::numeric_limits<std::uint32_t>::max();
};

double center(const Aabb& box, int axis) { return 0.5 * box.lower[axis] + 0.5 * box.upper[axis]; }

class Collapser {
 public:
  Collapser(const BinaryTree& binary, WideTree& tree, unsigned level_limit)
      : binary_(binary), tree_(tree), level_limit_(level_limit), first_(binary.nodes.size()), count_(first_.size()) {
    // Children follow their parents, so one sweep from the back sums the ranges.
    for (std::size_t i = binary.nodes.size(); i-- > 0;) {
      const BinaryNode& node = binary.nodes[i];
      first_[i] = node.count > 0 ? node.left : first_[node.left];
      count_[i] = node.count > 0 ? node.count : count_[node.left] + count_[node.right];
    }
  }

  void run() {
    // Depth first with an explicit stack: adversarial scenes make deep trees.
    std::vector<Pending> stack{{piece_of(0), 0, 0, 0}};
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
    return {binary_.nodes[binary].box, first_[binary], count_[binary], binary};
  }

  [[nodiscard]] Piece range_piece(std::uint32_t first, std::uint32_t count) const {
    Piece piece{{}, first, count, Piece::kBalanced};
    for (std::uint32_t i = first; i < first + count; ++i) {
      piece.box.grow(bounds(tree_.triangles[i]));
    }
    return piece;
  }

  [[nodiscard]] bool can_open(const Piece& piece) const {
    return piece.binary != Piece::kBalanced && binary_.nodes[piece.binary].count == 0;
  }

  // The pieces under one wide node, by opening the largest until `width` stand.
  std::vector<Piece> open_largest(const Piece& piece) const {
    std::vector<Piece> pieces{piece};
    while (pieces.size() < tree_.width) {
      std::size_t best = pieces.size();
      for (std::size_t i = 0; i < pieces.size(); ++i) {
        if (can_open(pieces[i]) &&
            (best == pieces.size() || pieces[i].box.half_area() > pieces[best].box.half_area())) {
          best = i;
        }
      }
      if (best == pieces.size()) {
        break;
      }
      const BinaryNode& node = binary_.nodes[pieces[best].binary];
      pieces[best] = piece_of(node.left);
      pieces.insert(pieces.begin() + static_cast<std::ptrdiff_t>(best) + 1, piece_of(node.right));
    }
    return pieces;
  }

  // Equal shares of the range, each within what `levels_left` levels below can hold.
  std::vector<Piece> split_balanced(const Piece& piece, unsigned levels_left) const {
    std::uint64_t capacity = kMaxLeafTriangles;
    for (unsigned i = 0; i < levels_left && capacity < piece.count; ++i) {
      capacity *= tree_.width;
    }
    const auto parts = static_cast<std::uint32_t>(std::clamp<std::uint64_t>(
        (piece.count + capacity - 1) / capacity, std::min<std::uint64_t>(piece.count, 2), tree_.width));
    std::vector<Piece> pieces;
    for (std::uint32_t i = 0; i < parts; ++i) {
      const auto begin = static_cast<std::uint32_t>(std::uint64_t(piece.count) * i / parts);
      const auto end = static_cast<std::uint32_t>(std::uint64_t(piece.count) * (i + 1) / parts);
      pieces.push_back(range_piece(piece.first + begin, end - begin));
    }
    return pieces;
  }

  void place_children(std::uint32_t index, const Pending& pending, std::vector<Pending>& stack) {
    const unsigned levels_left = level_limit_ - pending.level;  // this node's level included
    const bool balanced =
        pending.piece.binary == Piece::kBalanced || balanced_levels(pending.piece.count, tree_.width) >= levels_left;
    const std::vector<Piece> pieces =
        balanced ? split_balanced(pending.piece, levels_left - 1) : open_largest(pending.piece);

    WideNode node;
    node.parent = pending.parent;
    node.level = static_cast<std::uint8_t>(pending.level);
    tree_.levels = std::max(tree_.levels, pending.level + 1);
    const std::array<unsigned, kMaxWidth> slots = assign_slots(pieces, pending.piece.box, node.order);
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      const unsigned slot = slots[i];
      const Piece& piece = pieces[i];
      node.valid = static_cast<std::uint8_t>(node.valid | 1U << slot);
      node.boxes[slot] = piece.box;
      const bool leaf = piece.count <= kMaxLeafTriangles && !can_open(piece);
      if (leaf) {
        node.child[slot] = piece.first;
        node.count[slot] = static_cast<std::uint8_t>(piece.count);
      } else {
        assert(pending.level + 1 < level_limit_);
        stack.push_back({piece, index, slot, pending.level + 1});
      }
    }
    tree_.nodes[index] = node;
    std::reverse(stack.end() - static_cast<std::ptrdiff_t>(inner_count(node)), stack.end());
  }

  [[nodiscard]] unsigned inner_count(const WideNode& node) const {
    unsigned inner = 0;
    for (unsigned slot = 0; slot < tree_.width; ++slot) {
      inner += node.has(slot) && !node.is_leaf(slot) ? 1 : 0;
    }
    return inner;
  }

  // Greedy assignment: the (child, slot) pair of largest projection on the slot's diagonal first.
  [[nodiscard]] std::array<unsigned, kMaxWidth> assign_slots(const std::vector<Piece>& pieces, const Aabb& box,
                                                             std::uint8_t& order) const {
    const unsigned bits = tree_.width == 8 ? 3 : 2;
    std::array<int, 3> axes{0, 1, 2};
    if (bits == 2) {
      std::stable_sort(axes.begin(), axes.end(),
                       [&](int a, int b) { return box.upper[a] - box.lower[a] > box.upper[b] - box.lower[b]; });
    }
    order = static_cast<std::uint8_t>(axes[0] | axes[1] << 2);
    std::array<std::array<double, kMaxWidth>, kMaxWidth> gain{};
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      for (unsigned slot = 0; slot < tree_.width; ++slot) {
        for (unsigned bit = 0; bit < bits; ++bit) {
          const double offset = center(pieces[i].box, axes[bit]) - center(box, axes[bit]);
          gain[i][slot] += (slot >> bit & 1) != 0 ? offset : -offset;
        }
      }
    }
    std::array<unsigned, kMaxWidth> slots{};
    unsigned placed = 0, taken = 0;
    for (std::size_t step = 0; step < pieces.size(); ++step) {
      double best = -std::numeric_limits<double>::infinity();
      std::size_t best_piece = 0;
      unsigned best_slot = 0;
      for (std::size_t i = 0; i < pieces.size(); ++i) {
        for (unsigned slot = 0; slot < tree_.width; ++slot) {
          if ((placed >> i & 1) == 0 && (taken >> slot & 1) == 0 && gain[i][slot] > best) {
            best = gain[i][slot];
            best_piece = i;
            best_slot = slot;
          }
        }
      }
      slots[best_piece] = best_slot;
      placed |= 1U << best_piece;
      taken |= 1U << best_slot;
    }
    return slots;
  }

  const BinaryTree& binary_;
  WideTree& tree_;
  unsigned level_limit_;
  std::vector<std::uint32_t> first_;
  std::vector<std::uint32_t> count_;
};

}  // namespace

WideTree collapse(const BinaryTree& binary, std::vector<Triangle> triangles, unsigned width, unsigned level_limit) {
  assert(balanced_levels(triangles.size(), width) <= level_limit);
  WideTree tree;
  tree.width = width;
  tree.triangles = std::move(triangles);
  tree.bounds = binary.nodes[0].box;
  Collapser(binary, tree, level_limit).run();
  return tree;
}

}  // namespace raymill::storage
