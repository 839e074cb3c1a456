// The traversal kernels for the expanded layout (expanded_tree.h), compiled once per ISA. The includer defines
// RAYMILL_ISA and includes its simd header first.
//
// The same traversal as kernel-inl.h's, without pages: a ray starts at the root and runs until it is done. Rays that
// have a line in common go as a packet (packet-inl.h), the others take turns, as there, in rounds of fewer steps.
//
//      visit: boxes ---> advance: next child ---> a node: visit, in the next round
//                          ^                      a leaf: filter, in the next round
//                          |                      none: report -> next ray
//      filter ---> decide -+
#pragma once

#include <algorithm>

#include "traversal/kernels/expanded_ray-inl.h"
#include "traversal/kernels/packet-inl.h"
#include "traversal/kernels/step_lists-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

template <int N, Query kQuery, Mode kMode>
struct alignas(64) ExpandedLane : ExpandedRay<kQuery, kMode> {
  static constexpr unsigned kLevels = storage::kBitstackBits / N;

  unsigned level;        // of the node that is visited next
  std::uint32_t levels;  // bit for each level with a mask left
  std::array<std::uint8_t, kLevels> masks;
  // One past the deepest, for it is written before it is known whether the child is a node.
  std::array<const ExpandedNode<N>*, kLevels + 1> nodes;
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

  void run() {
    for (RayLane& lane : lanes_) {
      take_ray(&lane);
    }
    for (unsigned round = 0; !lists_[round & 1].empty(); ++round) {
      Lists& now = lists_[round & 1];
      now_ = &now;
      next_ = &lists_[(round + 1) & 1];
      nodes_visited_ += now.count[kVisitNode];
      now.each(kVisitNode, [this](RayLane* lane) { visit(lane); });
      now.each(kFilterLeaf, [this](RayLane* lane) { filter_leaf(lane); });
      now.each(kDecideLeaf, [this](RayLane* lane) { decide_leaf(lane); });
      now.each(kAdvanceRay, [this](RayLane* lane) { advance(lane); });
      now.each(kReportRay, [this](RayLane* lane) { report(lane); });
    }
    context_.counters.nodes_visited += nodes_visited_;
    context_.counters.triangles_tested += triangles_tested_;
  }

 private:
  static constexpr unsigned kLanes = 24;
  enum Step : unsigned { kVisitNode, kFilterLeaf, kReportRay, kDecideLeaf, kAdvanceRay, kSteps };
  using RayLane = ExpandedLane<N, kQuery, kMode>;
  using Lists = StepLists<RayLane, kLanes, kSteps>;

  void take_ray(RayLane* lane) {
    // A packet that gave up leaves rays that have the hit they want.
    while (kQuery == Query::any && taken_ < rays_.size() && is_hit(hits_[taken_])) {
      ++taken_;
    }
    if (taken_ == rays_.size()) {
      return;
    }
    lane->begin(rays_[taken_], hits_[taken_]);
    ++taken_;
    lane->level = 0;
    lane->levels = 0;
    lane->nodes[0] = nodes_ + context_.tree.root;
    next_->add(kVisitNode, lane);
  }

  [[gnu::always_inline]] void visit(RayLane* lane) {
    const unsigned level = lane->level;
    const unsigned mask =
        test_planes<N, kMode>(*lane->nodes[level], lane->frame, lane->tnear, lane->tfar, lane->entries[level]);
    lane->masks[level] = static_cast<std::uint8_t>(mask);
    lane->levels |= static_cast<std::uint32_t>(mask != 0) << level;
    now_->add(kAdvanceRay, lane);
  }

  // Chooses the next pending child and asks for its memory. No branch on what the child is: it could not be foretold.
  [[gnu::always_inline]] void advance(RayLane* lane) {
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
      const std::uint32_t child = node.child[slot], count = node.count[slot];
      const unsigned is_leaf = count != 0;
      lane->nodes[level + 1] = nodes_ + child;
      lane->leaf = {blocks_ + child, count};
      lane->level = level + 1;
      const auto* wanted = is_leaf != 0 ? reinterpret_cast<const std::byte*>(blocks_ + child)
                                        : reinterpret_cast<const std::byte*>(nodes_ + child);
      const std::size_t last = is_leaf != 0 ? kCornerRows * sizeof(float) * count - 1 : sizeof(node) - 1;
      __builtin_prefetch(wanted);
      __builtin_prefetch(wanted + std::min<std::size_t>(last, 64));
      __builtin_prefetch(wanted + std::min<std::size_t>(last, 128));
      __builtin_prefetch(wanted + last);
      next_->add(is_leaf != 0 ? kFilterLeaf : kVisitNode, lane);
      return;
    }
    finish(lane);
  }

  void filter_leaf(RayLane* lane) {
    triangles_tested_ += lane->leaf.count;
    lane->filter_leaf();
    now_->add(lane->candidates != 0 ? kDecideLeaf : kAdvanceRay, lane);
  }

  void decide_leaf(RayLane* lane) {
    if (lane->decide_leaf(context_)) {
      finish(lane);
    } else {
      now_->add(kAdvanceRay, lane);
    }
  }

  void finish(RayLane* lane) {
    if (lane->hit_leaf.rows == nullptr) {
      report(lane);
      return;
    }
    __builtin_prefetch(lane->hit_ids());
    __builtin_prefetch(lane->hit_ids() + lane->hit_leaf.count);
    next_->add(kReportRay, lane);
  }
  void report(RayLane* lane) {
    lane->report_ids();
    take_ray(lane);
  }

  ExpandedContext& context_;
  const ExpandedNode<N>* const nodes_;
  const float* const blocks_;
  const std::span<const Ray> rays_;
  const std::span<Hit> hits_;
  std::size_t taken_ = 0;
  std::uint64_t nodes_visited_ = 0, triangles_tested_ = 0;
  std::array<Lists, 2> lists_;
  Lists* now_ = &lists_[1];
  Lists* next_ = &lists_[0];
  std::array<RayLane, kLanes> lanes_;
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
