// The traversal kernel for the expanded layout (expanded_tree.h), compiled once per ISA. The includer defines
// RAYMILL_ISA and includes its simd header first.
//
// The same traversal as kernel-inl.h's, without pages: a ray starts at the root and runs until it is done. Boxes,
// triangle tests and the order of children are the same functions; the rounds are the same idea, of fewer steps.
//
//      visit: boxes ---> advance: next child ---> a node: visit, in the next round
//                          ^                      a leaf: filter, in the next round
//                          |                      none: report -> next ray
//      filter ---> decide -+
#pragma once

#include "traversal/expanded_tree.h"
#include "traversal/kernels/kernel-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

// The same numbers as test_boxes (kernel-inl.h) from planes that are decoded.
template <int N>
[[gnu::always_inline]] inline unsigned test_planes(const ExpandedNode<N>& node, const RayFrame& ray, float tnear,
                                                   float tfar, std::array<float, N>& entries) {
  auto near = Floats<N>::broadcast(tnear), far = Floats<N>::broadcast(std::numeric_limits<float>::infinity());
  for (int axis = 0; axis < 3; ++axis) {
    const unsigned negative = ray.octant >> axis & 1;
    const auto org = Floats<N>::broadcast(ray.org[axis]), rdir = Floats<N>::broadcast(ray.rdir[axis]);
    near = max_keep((Floats<N>::load(node.planes[negative][axis].data()) - org) * rdir, near);
    far = min_keep((Floats<N>::load(node.planes[negative ^ 1][axis].data()) - org) * rdir, far);
  }
  far = far + abs(far) * Floats<N>::broadcast(kExitPad);
  near.store(entries.data());
  return less_equal(near, min_keep(far, Floats<N>::broadcast(tfar))) & node.valid;
}

template <int N>
struct alignas(64) ExpandedLane {
  static constexpr unsigned kLevels = storage::kBitstackBits / N;

  RayFrame frame;
  float tnear, tfar;
  RayState* ray;
  unsigned level;        // of the node that is visited next
  std::uint32_t levels;  // bit for each level with a mask left
  LeafRows leaf;         // that is tested next
  unsigned candidates;   // of its triangles
  Quotients quotients;   // of them, in mode fast
  LeafRows hit_leaf;     // rows null: the ids of the best hit stand in the ray
  std::uint32_t hit_triangle;
  std::array<std::uint8_t, kLevels> masks;
  // One past the deepest, for it is written before it is known whether the child is a node.
  std::array<const ExpandedNode<N>*, kLevels + 1> nodes;
  std::array<std::array<float, N>, kLevels> entries;
};

template <int N, Query kQuery, Mode kMode>
class ExpandedBatch {
 public:
  ExpandedBatch(ExpandedContext& context, std::span<RayState> rays)
      : context_(context),
        nodes_(static_cast<const ExpandedNode<N>*>(context.tree.nodes)),
        blocks_(context.tree.blocks),
        rays_(rays) {}

  void run() {
    for (RayLane& lane : lanes_) {
      take_ray(&lane);
    }
    for (unsigned round = 0; !lists_[round & 1].empty(); ++round) {
      Lists& now = lists_[round & 1];
      now_ = &now;
      next_ = &lists_[(round + 1) & 1];
      nodes_visited_ += now.count[kVisitNode];
      each(now, kVisitNode, [this](RayLane* lane) { visit(lane); });
      each(now, kFilterLeaf, [this](RayLane* lane) { filter_leaf(lane); });
      each(now, kDecideLeaf, [this](RayLane* lane) { decide_leaf(lane); });
      each(now, kAdvanceRay, [this](RayLane* lane) { advance(lane); });
      each(now, kReportRay, [this](RayLane* lane) { report(lane); });
    }
    context_.counters.nodes_visited += nodes_visited_;
    context_.counters.triangles_tested += triangles_tested_;
  }

 private:
  static constexpr unsigned kLanes = 24;
  enum Step : unsigned { kVisitNode, kFilterLeaf, kReportRay, kDecideLeaf, kAdvanceRay, kSteps };
  using RayLane = ExpandedLane<N>;
  struct Lists {
    std::array<std::array<RayLane*, kLanes>, kSteps> lanes;
    std::array<unsigned, kSteps> count{};
    void add(unsigned step, RayLane* lane) { lanes[step][count[step]++] = lane; }
    [[nodiscard]] bool empty() const { return count == std::array<unsigned, kSteps>{}; }
  };

  template <typename Do>
  static void each(Lists& lists, Step step, Do&& make_step) {
    const unsigned count = lists.count[step];
    lists.count[step] = 0;
    for (unsigned i = 0; i < count; ++i) {
      make_step(lists.lanes[step][i]);
    }
  }

  void take_ray(RayLane* lane) {
    if (taken_ == rays_.size()) {
      return;
    }
    RayState& ray = rays_[taken_++];
    lane->ray = &ray;
    lane->frame = make_frame(ray.org, ray.dir);
    lane->tnear = ray.tnear;
    lane->tfar = ray.tfar;
    lane->level = 0;
    lane->levels = 0;
    lane->hit_leaf.rows = nullptr;
    lane->nodes[0] = nodes_ + context_.tree.root;
    next_->add(kVisitNode, lane);
  }

  [[gnu::always_inline]] void visit(RayLane* lane) {
    const unsigned level = lane->level;
    const unsigned mask =
        test_planes<N>(*lane->nodes[level], lane->frame, lane->tnear, lane->tfar, lane->entries[level]);
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
      if (kQuery == Query::closest && !(lane->entries[level][slot] <= lane->tfar)) {
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
      prefetch(wanted);
      prefetch(wanted + std::min<std::size_t>(last, 64));
      prefetch(wanted + std::min<std::size_t>(last, 128));
      prefetch(wanted + last);
      next_->add(is_leaf != 0 ? kFilterLeaf : kVisitNode, lane);
      return;
    }
    finish(lane);
  }

  void filter_leaf(RayLane* lane) {
    triangles_tested_ += lane->leaf.count;
    const unsigned used = (1U << lane->leaf.count) - 1;
    if constexpr (kMode == Mode::watertight) {
      lane->candidates = woop_filter(lane->frame, lane->leaf, lane->tnear, lane->tfar) & used;
    } else {
      lane->candidates = moeller_trumbore(lane->frame, lane->leaf, lane->quotients) & used;
    }
    now_->add(lane->candidates != 0 ? kDecideLeaf : kAdvanceRay, lane);
  }

  void decide_leaf(RayLane* lane) {
    for (unsigned mask = lane->candidates; mask != 0; mask &= mask - 1) {
      const int i = std::countr_zero(mask);
      const Corners corners = lane->leaf.triangle(i);
      Candidate hit;
      if constexpr (kMode == Mode::watertight) {
        if (!woop_decide(lane->frame, corners, hit)) {
          continue;
        }
      } else {
        hit = {lane->quotients.t[i], lane->quotients.u[i], lane->quotients.v[i]};
      }
      if (offer(lane, hit, corners, static_cast<std::uint32_t>(i))) {
        finish(lane);
        return;
      }
    }
    now_->add(kAdvanceRay, lane);
  }

  // As kernel-inl.h's. True: no other hit is wanted.
  bool offer(RayLane* lane, const Candidate& hit, const Corners& corners, std::uint32_t triangle) {
    float t = 0;
    if (!clamp_to_box(lane->frame, corners, hit, lane->tnear, lane->tfar, t)) {
      return false;
    }
    RayState& ray = *lane->ray;
    if constexpr (kQuery == Query::any) {
      ray.hit = {};
      ray.hit.t = 0;
      ray.has_hit = true;
      return true;
    } else {
      if (t == lane->tfar && ray.has_hit && !comes_before(lane, triangle)) {
        return false;
      }
      lane->tfar = t;
      lane->hit_leaf = lane->leaf;
      lane->hit_triangle = triangle;
      ray.has_hit = true;
      ray.hit.t = t;
      set_barycentrics(ray.hit, hit);
      if (context_.need_normal) {
        ray.hit.normal = normal_of(corners);
      }
      return false;
    }
  }

  struct Ids {
    std::uint32_t geometry, primitive;
    bool operator<(const Ids& other) const {
      return geometry < other.geometry || (geometry == other.geometry && primitive < other.primitive);
    }
  };
  static Ids ids_of(const LeafRows& leaf, std::uint32_t triangle) {
    const float* ids = leaf.rows + kCornerRows * leaf.count + triangle;
    return {std::bit_cast<std::uint32_t>(ids[leaf.count]), std::bit_cast<std::uint32_t>(ids[0])};
  }
  // At equal t.
  static bool comes_before(const RayLane* lane, std::uint32_t triangle) {
    return ids_of(lane->leaf, triangle) < ids_of(lane->hit_leaf, lane->hit_triangle);
  }

  void finish(RayLane* lane) {
    if (lane->hit_leaf.rows == nullptr) {
      report(lane);
      return;
    }
    const float* ids = lane->hit_leaf.rows + kCornerRows * lane->hit_leaf.count + lane->hit_triangle;
    prefetch(ids);
    prefetch(ids + lane->hit_leaf.count);
    next_->add(kReportRay, lane);
  }
  void report(RayLane* lane) {
    RayState& ray = *lane->ray;
    if (lane->hit_leaf.rows != nullptr) {
      const Ids ids = ids_of(lane->hit_leaf, lane->hit_triangle);
      ray.hit.geometry_id = ids.geometry;
      ray.hit.primitive_id = ids.primitive;
    }
    ray.tfar = lane->tfar;
    ray.done = true;
    take_ray(lane);
  }

  ExpandedContext& context_;
  const ExpandedNode<N>* const nodes_;
  const float* const blocks_;
  const std::span<RayState> rays_;
  std::size_t taken_ = 0;
  std::uint64_t nodes_visited_ = 0, triangles_tested_ = 0;
  std::array<Lists, 2> lists_;
  Lists* now_ = &lists_[1];
  Lists* next_ = &lists_[0];
  std::array<RayLane, kLanes> lanes_;
};

template <int N, Query kQuery, Mode kMode>
void trace_expanded(ExpandedContext& context, std::span<RayState> rays) {
  ExpandedBatch<N, kQuery, kMode>(context, rays).run();
}

template <int N, Query kQuery>
ExpandedKernel select_expanded_mode(Mode mode) {
  return mode == Mode::watertight ? &trace_expanded<N, kQuery, Mode::watertight>
                                  : &trace_expanded<N, kQuery, Mode::fast>;
}

template <int N>
ExpandedKernel select_expanded_query(const KernelChoice& choice) {
  return choice.query == Query::closest ? select_expanded_mode<N, Query::closest>(choice.mode)
                                        : select_expanded_mode<N, Query::any>(choice.mode);
}

inline ExpandedKernel select_expanded_kernel(const KernelChoice& choice) {
  return choice.width == 8 ? select_expanded_query<8>(choice) : select_expanded_query<4>(choice);
}

}  // namespace raymill::traversal::RAYMILL_ISA
