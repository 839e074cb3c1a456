// The traversal kernels for the expanded layout (expanded_tree.h), compiled once per ISA. The includer defines
// RAYMILL_ISA and includes its simd header first.
//
// The same traversal as kernel-inl.h's, without pages: a ray starts at the root and runs until it is done. Rays that
// have a line in common go as a packet (packet-inl.h), the others take turns. In a round each of them visits a node,
// then meets all leaves there whose boxes it meets, and then chooses the next node; between these steps the others' are
// made, so that what was prefetched has arrived.
//
//      visit: boxes ---> filter ---> decide ---> advance: next node ---> visit, in the next round
//                                                         none: report -> next ray
#pragma once

#include <algorithm>

#include "traversal/kernels/expanded_ray-inl.h"
#include "traversal/kernels/packet-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

// offset[count]: bytes of a block whose lines hold its corners; the last ones twice where it has fewer.
struct CornerLinesTable {
  static constexpr unsigned kLines = 5;
  std::uint16_t offset[9][kLines] = {};
  constexpr CornerLinesTable() {
    for (unsigned count = 1; count <= 8; ++count) {
      for (unsigned line = 0; line < kLines; ++line) {
        const unsigned last = kCornerRows * sizeof(float) * count - 1;
        offset[count][line] = static_cast<std::uint16_t>(line + 1 < kLines ? std::min(line * 64, last) : last);
      }
    }
  }
};
inline constexpr CornerLinesTable kCornerLines;

template <int N, Query kQuery, Mode kMode>
struct alignas(64) ExpandedLane : ExpandedRay<kQuery, kMode> {
  static constexpr unsigned kLevels = storage::kBitstackBits / N;

  unsigned level;                           // of the node that is visited next
  std::uint32_t levels;                     // bit for each level with a mask left
  std::array<std::uint8_t, kLevels> masks;  // children that are nodes and still to be visited
  std::array<const ExpandedNode<N>*, kLevels> nodes;
  std::array<std::array<float, N>, kLevels> entries;
};

template <int N, Query kQuery, Mode kMode>
class ExpandedBatch {
 public:
  ExpandedBatch(ExpandedContext& context, std::span<const Ray> rays, std::span<Hit> hits)
      : context_(context),
        nodes_(static_cast<const ExpandedNode<N>*>(context.tree.nodes)),
        blocks_(context.tree.blocks),
        rays_(rays),
        hits_(hits) {}

  // Between a group's visit and its leaves, and between these and its next visit, stand steps of the other two.
  void run() {
    for (unsigned i = 0; i < kGroups * kGroupLanes; ++i) {
      take_ray(&lanes_[i], groups_[i % kGroups]);
    }
    for (unsigned turn = 0; active_ != 0; ++turn) {
      visit(groups_[turn % kGroups]);
      if (turn != 0) {
        meet_leaves(groups_[(turn + kGroups - 1) % kGroups]);
      }
    }
    context_.counters.nodes_visited += nodes_visited_;
    context_.counters.triangles_tested += triangles_tested_;
  }

 private:
  static constexpr unsigned kGroups = 3, kGroupLanes = 16;
  using RayLane = ExpandedLane<N, kQuery, kMode>;
  struct LeafTest {
    RayLane* lane;
    LeafRows leaf;
  };
  struct Decision {
    RayLane* lane;
    LeafRows leaf;
    unsigned candidates;
    Quotients quotients;
  };
  // Rays that make a step one after the other.
  struct Group {
    unsigned visit_count = 0, leaf_count = 0, report_count = 0;
    std::array<RayLane*, kGroupLanes> visits, reports;
    std::array<std::uint8_t, kGroupLanes> leaves;
    std::array<LeafTest, kGroupLanes * N> leaf_tests;
  };

  void take_ray(RayLane* lane, Group& group) {
    // A packet that gave up leaves rays that have the hit they want.
    while (kQuery == Query::any && taken_ < rays_.size() && is_hit(hits_[taken_])) {
      ++taken_;
    }
    if (taken_ == rays_.size()) {
      return;
    }
    lane->begin(rays_[taken_], hits_[taken_]);
    ++taken_;
    ++active_;
    lane->level = 0;
    lane->levels = 0;
    lane->nodes[0] = nodes_ + context_.tree.root;
    group.visits[group.visit_count++] = lane;
  }

  void visit(Group& group) {
    report_rays(group);
    nodes_visited_ += group.visit_count;
    // No branch depends on what a node holds: those of other rays are on their way meanwhile.
    for (unsigned i = 0; i < group.visit_count; ++i) {
      RayLane* lane = group.visits[i];
      const unsigned level = lane->level;
      const ExpandedNode<N>& node = *lane->nodes[level];
      const unsigned mask = test_planes<N, kMode>(node, lane->frame, lane->tnear, lane->tfar, lane->entries[level]);
      const unsigned inner = mask & ~node.leaves;
      lane->masks[level] = static_cast<std::uint8_t>(inner);
      lane->levels |= static_cast<std::uint32_t>(inner != 0) << level;
      group.leaves[i] = static_cast<std::uint8_t>(mask & node.leaves);
    }
    list_leaves(group);
  }

  void list_leaves(Group& group) {
    LeafTest* next = group.leaf_tests.data();
    for (unsigned i = 0; i < group.visit_count; ++i) {
      RayLane* lane = group.visits[i];
      const ExpandedNode<N>& node = *lane->nodes[lane->level];
      for (unsigned leaves = group.leaves[i]; leaves != 0;) {
        const unsigned slot = first_slot<N>(node, lane->frame.octant, leaves);
        leaves &= ~(1U << slot);
        *next = {lane, {blocks_ + node.child[slot], node.count[slot]}};
        const auto* first = reinterpret_cast<const std::byte*>(next->leaf.rows);
        for (const std::uint16_t offset : kCornerLines.offset[next->leaf.count]) {
          __builtin_prefetch(first + offset);
        }
        ++next;
      }
    }
    group.leaf_count = static_cast<unsigned>(next - group.leaf_tests.data());
  }

  void meet_leaves(Group& group) {
    Decision* next = decisions_.data();
    for (unsigned i = 0; i < group.leaf_count; ++i) {
      const LeafTest& test = group.leaf_tests[i];
      triangles_tested_ += test.leaf.count;
      next->candidates = test.lane->filter_leaf(test.leaf, next->quotients);
      next->lane = test.lane;
      next->leaf = test.leaf;
      next += static_cast<unsigned>(next->candidates != 0);
    }
    for (const Decision* decision = decisions_.data(); decision != next; ++decision) {
      if (decision->lane->decide_leaf(context_, decision->leaf, decision->candidates, decision->quotients)) {
        decision->lane->levels = 0;
      }
    }
    advance_rays(group);
  }

  // Chooses each ray's next pending child and asks for its memory.
  void advance_rays(Group& group) {
    const unsigned count = group.visit_count;
    group.visit_count = 0;
    group.leaf_count = 0;
    for (unsigned i = 0; i < count; ++i) {
      RayLane* lane = group.visits[i];
      if (advance(lane)) {
        group.visits[group.visit_count++] = lane;
      } else {
        finish(lane, group);
      }
    }
  }

  [[gnu::always_inline]] bool advance(RayLane* lane) {
    while (lane->levels != 0) {
      const auto level = static_cast<unsigned>(std::bit_width(lane->levels)) - 1;
      const ExpandedNode<N>& node = *lane->nodes[level];
      const unsigned mask = lane->masks[level];
      const unsigned slot = first_slot<N>(node, lane->frame.octant, mask);
      lane->masks[level] = static_cast<std::uint8_t>(mask & ~(1U << slot));
      lane->levels ^= static_cast<std::uint32_t>((mask & (mask - 1)) == 0) << level;
      // Too far: what was hit since the mask was made lies before the child's box.
      if (kQuery == Query::closest && !(lane->entries[level][slot] <= end_of<kMode>(lane->tfar))) {
        continue;
      }
      const ExpandedNode<N>* child = nodes_ + node.child[slot];
      lane->nodes[level + 1] = child;
      lane->level = level + 1;
      const auto* wanted = reinterpret_cast<const std::byte*>(child);
      __builtin_prefetch(wanted);
      __builtin_prefetch(wanted + 64);
      __builtin_prefetch(wanted + 128);
      __builtin_prefetch(wanted + sizeof(*child) - 1);
      return true;
    }
    return false;
  }

  void finish(RayLane* lane, Group& group) {
    if (lane->hit_leaf.rows != nullptr) {
      __builtin_prefetch(lane->hit_ids());
      __builtin_prefetch(lane->hit_ids() + lane->hit_leaf.count);
    }
    group.reports[group.report_count++] = lane;
  }
  void report_rays(Group& group) {
    for (unsigned i = 0; i < group.report_count; ++i) {
      group.reports[i]->report_ids();
      --active_;
      take_ray(group.reports[i], group);
    }
    group.report_count = 0;
  }

  ExpandedContext& context_;
  const ExpandedNode<N>* const nodes_;
  const float* const blocks_;
  const std::span<const Ray> rays_;
  const std::span<Hit> hits_;
  std::size_t taken_ = 0;
  unsigned active_ = 0;
  std::uint64_t nodes_visited_ = 0, triangles_tested_ = 0;
  std::array<Group, kGroups> groups_;
  std::array<Decision, kGroupLanes * N + 1> decisions_;  // one more than leaves: it is written before it is needed
  std::array<RayLane, kGroups * kGroupLanes> lanes_;
};

// Each ray on its own.
template <int N, Query kQuery, Mode kMode>
void trace_alone(ExpandedContext& context, std::span<const Ray> rays, std::span<Hit> hits) {
  if (!rays.empty()) {
    ExpandedBatch<N, kQuery, kMode>(context, rays, hits).run();
  }
}

template <int N, Query kQuery, Mode kMode>
void trace_expanded(ExpandedContext& context, std::span<const Ray> rays, std::span<Hit> hits) {
  using Packet = ExpandedPacket<N, kQuery, kMode>;
  std::size_t alone = 0;  // rays from here on
  bool tries_packets = context.packets;
  for (std::size_t at = 0; tries_packets && at + Packet::kRays <= rays.size(); at += Packet::kRays) {
    const auto together = rays.subspan(at).template first<Packet::kRays>();
    const PacketBounds bounds(together);
    if (bounds.coherent(context.tree.coherent_width)) {
      trace_alone<N, kQuery, kMode>(context, rays.subspan(alone, at - alone), hits.subspan(alone, at - alone));
      // Where one packet shares too little, so will the others of the batch.
      tries_packets = Packet(context, together, hits.subspan(at).template first<Packet::kRays>(), bounds).run();
      alone = tries_packets ? at + Packet::kRays : at;
    }
  }
  trace_alone<N, kQuery, kMode>(context, rays.subspan(alone), hits.subspan(alone));
}

template <int N, Query kQuery>
ExpandedKernel select_expanded_mode(Mode mode) {
  switch (mode) {
    case Mode::fast:
      return &trace_expanded<N, kQuery, Mode::fast>;
    case Mode::exact:
      return &trace_expanded<N, kQuery, Mode::exact>;
    default:
      return &trace_expanded<N, kQuery, Mode::watertight>;
  }
}

// For crossings, whether they are listed or counted. A packet that gives up would find some again: rays go alone.
template <int N>
ExpandedKernel select_crossings_mode(Mode mode) {
  switch (mode) {
    case Mode::fast:
      return &trace_alone<N, Query::all, Mode::fast>;
    case Mode::exact:
      return &trace_alone<N, Query::all, Mode::exact>;
    default:
      return &trace_alone<N, Query::all, Mode::watertight>;
  }
}

template <int N>
ExpandedKernel select_expanded_query(const KernelChoice& choice) {
  switch (choice.query) {
    case Query::closest:
      return select_expanded_mode<N, Query::closest>(choice.mode);
    case Query::any:
      return select_expanded_mode<N, Query::any>(choice.mode);
    default:
      return select_crossings_mode<N>(choice.mode);
  }
}

inline ExpandedKernel select_expanded_kernel(const KernelChoice& choice) {
  return choice.width == 8 ? select_expanded_query<8>(choice) : select_expanded_query<4>(choice);
}

}  // namespace raymill::traversal::RAYMILL_ISA
