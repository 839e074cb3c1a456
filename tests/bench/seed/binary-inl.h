// Algorithms that know binary trees alone: restart trail, skip pointers, parent pointers. Compiled once per ISA.
//
// The bitstack for binary trees, which came before the paper, is Stackless<2> of wide-inl.h.
#pragma once

#include "tests/bench/seed/states.h"
#include "tests/bench/seed/tests-inl.h"

namespace raymill::bench::RAYMILL_ISA {

/// Laine 2010, on nodes of two child boxes. Bit by bit from the highest, the trail says for each level on the path that
/// only one child is left to visit there: the near one is done, or only one was hit. To pop is to add one at the ray's
/// level, which carries to the deepest level where the far child waits, and to begin at the root again.
///
/// On the way down from the root the same children are hit, for tfar is never less than where the path's nodes begin:
/// the nearest hit, once found, lies in a leaf under each of them. Only at the popped level can the far child have come
/// to lie too far; the one that is hit is then the near one, which is done.
struct RestartTrail {
  static constexpr const char* kName = "restart trail";
  static constexpr unsigned kWidth = 2;
  static constexpr bool kWide = true;
  using State = TrailState;

  template <bool kCounts>
  static void trace(const Trees& trees, RayWork& ray, Tally<kCounts>& tally) {
    const Node<2>* nodes = trees.of_width<2>().nodes.data();
    std::uint64_t trail = 0, level = kAboveRoot, popped_level = 0;
    std::uint32_t reference = 0;
    for (;;) {
      if (is_leaf(reference)) {
        test_leaf(trees, reference, ray, tally);
      } else {
        const Node<2>& node = nodes[reference];
        std::array<float, 2> entries;
        const unsigned mask = test_boxes<2>(node, ray, entries);
        tally.node(static_cast<unsigned>(std::popcount(mask)));
        level >>= 1;
        if (mask == 3) {
          const unsigned far = entries[1] < entries[0] ? 0 : 1;
          reference = node.child[(trail & level) != 0 ? far : 1 - far];
          continue;
        }
        if (mask != 0 && level != popped_level) {
          trail |= level;
          reference = node.child[mask >> 1];
          continue;
        }
      }
      // pop
      trail = (trail & -level) + level;
      if ((trail & kAboveRoot) != 0) {
        return;
      }
      popped_level = trail & -trail;
      level = kAboveRoot;
      reference = 0;
    }
  }

 private:
  static constexpr std::uint64_t kAboveRoot = std::uint64_t{1} << 63;
};

template <typename NodeType>
bool meets(const RayWork& ray, const NodeType& node) {
  return test_box(ray, [&](unsigned row) { return node.planes[row]; }).is_hit;
}

/// Smits 1998: the tree's own order, whatever the ray's direction.
struct SkipPointers {
  static constexpr const char* kName = "skip pointers";
  static constexpr unsigned kWidth = 2;
  static constexpr bool kWide = false;
  using State = SkipState;

  template <bool kCounts>
  static void trace(const Trees& trees, RayWork& ray, Tally<kCounts>& tally) {
    const SkipNode* nodes = trees.skip_nodes.data();
    const auto end = static_cast<std::uint32_t>(trees.skip_nodes.size());
    for (std::uint32_t at = 0; at != end;) {
      const SkipNode& node = nodes[at];
      const bool is_hit = meets(ray, node);
      tally.node(is_hit ? 1 : 0);
      if (is_hit && node.leaf != 0) {
        test_leaf(trees, node.leaf, ray, tally);
      }
      at = is_hit ? at + 1 : node.skip;
    }
  }
};

/// Hapala et al. 2011: the next step follows from where the ray comes from. The near child is found by the sign of dir
/// on the node's axis, the same on the way down and on the way up.
struct ParentPointers {
  static constexpr const char* kName = "parent pointers";
  static constexpr unsigned kWidth = 2;
  static constexpr bool kWide = false;
  using State = ParentState;

  template <bool kCounts>
  static void trace(const Trees& trees, RayWork& ray, Tally<kCounts>& tally) {
    const LinkedNode* nodes = trees.linked_nodes.data();
    const auto near_child = [&](std::uint32_t node) {
      return nodes[node].child + (ray.frame.octant >> nodes[node].axis() & 1);
    };
    std::uint32_t at = near_child(0);
    From from = From::parent;
    for (;;) {
      if (from == From::child) {
        if (at == 0) {
          return;
        }
        const std::uint32_t parent = nodes[at].parent();
        const bool was_near = at == near_child(parent);
        at = was_near ? at ^ 1 : parent;
        from = was_near ? From::sibling : From::child;
        continue;
      }
      const LinkedNode& node = nodes[at];
      const bool is_hit = meets(ray, node);
      tally.node(is_hit ? 1 : 0);
      if (is_hit && !is_leaf(node.child)) {
        at = near_child(at);
        from = From::parent;
        continue;
      }
      if (is_hit) {
        test_leaf(trees, node.child, ray, tally);
      }
      at = from == From::parent ? at ^ 1 : node.parent();
      from = from == From::parent ? From::sibling : From::child;
    }
  }

 private:
  enum class From { parent, sibling, child };
};

}  // namespace raymill::bench::RAYMILL_ISA
