// The algorithms on wide nodes: a stack, and the bitstack of Afra & Szirmay-Kalos 2014. Compiled once per ISA.
#pragma once

#include "tests/bench/seed/skip_codes-inl.h"
#include "tests/bench/seed/tests-inl.h"

namespace raymill::bench::RAYMILL_ISA {

/// A stack of children with their distances: nearest first, and what has come to lie too far is dropped at the pop.
template <unsigned N>
struct Stack {
  static constexpr const char* kName = kStackName;
  static constexpr unsigned kWidth = N;
  static constexpr bool kWide = true;
  using State = StackState<N>;

  template <bool kCounts>
  static void trace(const Trees& trees, RayWork& ray, Tally<kCounts>& tally) {
    const Node<N>* nodes = trees.of_width<N>().nodes.data();
    std::array<StackEntry, kStackEntries<N>> stack;
    unsigned size = 0;
    std::uint32_t reference = 0;
    for (;;) {
      if (is_leaf(reference)) {
        test_leaf(trees, reference, ray, tally);
      } else {
        const Node<N>& node = nodes[reference];
        std::array<float, N> entries;
        const unsigned mask = test_boxes<N>(node, ray, entries);
        tally.node(static_cast<unsigned>(std::popcount(mask)));
        if (mask != 0) {
          reference = push_all_but_nearest(node, mask, entries, stack, size);
          tally.entries(size);
          continue;
        }
      }
      // pop
      do {
        if (size == 0) {
          return;
        }
        --size;
      } while (stack[size].distance > ray.tfar);
      reference = stack[size].reference;
    }
  }

 private:
  [[gnu::always_inline]] static std::uint32_t push_all_but_nearest(const Node<N>& node, unsigned mask,
                                                                   const std::array<float, N>& entries,
                                                                   std::array<StackEntry, kStackEntries<N>>& stack,
                                                                   unsigned& size) {
    const auto entry_of = [&](unsigned bits) {
      const auto slot = static_cast<unsigned>(std::countr_zero(bits));
      return StackEntry{node.child[slot], entries[slot]};
    };
    StackEntry nearest = entry_of(mask);
    const unsigned bottom = size;
    for (mask &= mask - 1; mask != 0; mask &= mask - 1) {
      StackEntry entry = entry_of(mask);
      if (entry.distance < nearest.distance) {
        std::swap(entry, nearest);
      }
      unsigned place = size++;
      for (; place > bottom && stack[place - 1].distance < entry.distance; --place) {
        stack[place] = stack[place - 1];
      }
      stack[place] = entry;
    }
    return nearest.reference;
  }
};

/// Section 3 of the paper. Children are visited in circular order from the nearest one. No distance is kept: a child
/// taken from the bitstack is entered without another test of its own box; a node's children, then, are tested against
/// the tfar of now, a leaf's triangles are all tested.
///
/// Where we differ: leaves are no nodes and have no links. While the ray is among the children of a node just visited,
/// leaves are found by that node; afterwards by the siblings of the inner child that was entered last. The codes on the
/// bitstack always belong to an inner child.
template <unsigned N, typename Codes>
struct Stackless {
  static constexpr const char* kName = Codes::kName;
  static constexpr unsigned kWidth = N;
  static constexpr bool kWide = true;
  using State = StacklessState<N>;

  template <bool kCounts>
  static void trace(const Trees& trees, RayWork& ray, Tally<kCounts>& tally) {
    const Node<N>* nodes = trees.of_width<N>().nodes.data();
    Bitstack<N> bitstack;
    std::uint32_t at = 0;
    do {
      while (visit(trees, nodes[at], ray, bitstack, at, tally)) {
      }
    } while (backtrack(trees, nodes, ray, bitstack, at, tally));
  }

 private:
  // Tests the node's boxes, and leaves up to the first inner child in the order; true: that one is `at`.
  template <bool kCounts>
  [[gnu::always_inline]] static bool visit(const Trees& trees, const Node<N>& node, RayWork& ray, Bitstack<N>& bitstack,
                                           std::uint32_t& at, Tally<kCounts>& tally) {
    std::array<float, N> entries;
    const unsigned mask = test_boxes<N>(node, ray, entries);
    tally.node(static_cast<unsigned>(std::popcount(mask)));
    if (mask == 0) {
      return false;
    }
    unsigned slot = nearest(mask, entries);
    unsigned code = Codes::first(mask, slot);
    while (is_leaf(node.child[slot])) {
      test_leaf(trees, node.child[slot], ray, tally);
      if (code == 0) {
        return false;
      }
      slot = (slot + static_cast<unsigned>(std::countr_zero(code)) + 1) % N;
      code = Codes::next(code);
    }
    bitstack.push(code);
    at = node.child[slot];
    return true;
  }

  // Goes up to the deepest level where something is to be visited; true: an inner child, which is `at`.
  template <bool kCounts>
  [[gnu::always_inline]] static bool backtrack(const Trees& trees, const Node<N>* nodes, RayWork& ray,
                                               Bitstack<N>& bitstack, std::uint32_t& at, Tally<kCounts>& tally) {
    for (;;) {
      const unsigned code = bitstack.top();
      if (code == 0) {
        if (bitstack.empty()) {
          return false;
        }
        bitstack.pop();
        at = nodes[at].parent;
        continue;
      }
      const std::uint32_t sibling = nodes[at].sibling[static_cast<unsigned>(std::countr_zero(code))];
      if (is_leaf(sibling)) {
        // The code stays that of the inner child where we are.
        bitstack.replace_top(code, code & (code - 1));
        test_leaf(trees, sibling, ray, tally);
        continue;
      }
      bitstack.replace_top(code, Codes::next(code));
      at = sibling;
      return true;
    }
  }

  [[gnu::always_inline]] static unsigned nearest(unsigned mask, const std::array<float, N>& entries) {
    auto best = static_cast<unsigned>(std::countr_zero(mask));
    for (mask &= mask - 1; mask != 0; mask &= mask - 1) {
      const auto slot = static_cast<unsigned>(std::countr_zero(mask));
      best = entries[slot] < entries[best] ? slot : best;
    }
    return best;
  }
};

}  // namespace raymill::bench::RAYMILL_ISA
