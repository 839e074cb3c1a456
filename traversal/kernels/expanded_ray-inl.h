// A ray at work in the expanded layout, and what it does at nodes and leaves; compiled once per ISA. The includer
// defines RAYMILL_ISA and includes its simd header first.
//
// Every number that decides about a hit is that of kernel-inl.h: the same box formula, the same triangle tests, the
// same rule for equal t.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "traversal/expanded_tree.h"
#include "traversal/kernel.h"
#include "traversal/kernels/box_test-inl.h"
#include "traversal/kernels/exact-inl.h"
#include "traversal/kernels/slot_order-inl.h"
#include "traversal/kernels/triangle-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

// The same numbers as test_boxes (box_test-inl.h) from planes that are decoded.
template <int N, Mode kMode>
[[gnu::always_inline]] inline unsigned test_planes(const ExpandedNode<N>& node, const RayFrame& ray, float tnear,
                                                   float tfar, std::array<float, N>& entries) {
  auto interval = NearFar<N>::broadcast(begin_of<kMode>(tnear), std::numeric_limits<float>::infinity());
  for (int axis = 0; axis < 3; ++axis) {
    const auto planes = NearFar<N>::load(node.planes[axis][0].data(), ray.octant >> axis & 1);
    interval.tighten((planes - ray.org[axis]) * ray.rdir[axis]);
  }
  return meets_interval<N, kMode>(interval, tfar, entries) & node.valid;
}

// A hit has a finite t.
inline bool is_hit(const Hit& hit) { return hit.t < std::numeric_limits<float>::infinity(); }

template <Query kQuery, Mode kMode>
struct ExpandedRay {
  RayFrame frame;
  float tnear, tfar;  // tfar: of the best hit so far, else the ray's own
  Hit* answer;        // the best so far; its ids as soon as they are reported
  bool has_hit;
  LeafRows hit_leaf;  // rows null: nothing was hit here; the ids of what was hit before stand in the answer
  std::uint32_t hit_triangle;
  Corners hit_corners;  // in mode exact

  // `to`: a miss, or a hit that a packet left.
  void begin(const Ray& from, Hit& to) {
    answer = &to;
    frame = make_frame(from.org, from.dir);
    if constexpr (kMode == Mode::exact) {
      prepare_exact_boxes(frame);
    }
    tnear = from.tnear;
    has_hit = is_hit(to);
    tfar = has_hit ? to.t : std::min(from.tfar, std::numeric_limits<float>::max());
    hit_leaf.rows = nullptr;
  }

  // Which triangles of the leaf may be hit; in mode fast, their quotients.
  [[gnu::always_inline]] unsigned filter_leaf(const LeafRows& leaf, Quotients& quotients) const {
    const unsigned used = (1U << leaf.count) - 1;
    if constexpr (kMode == Mode::fast) {
      return moeller_trumbore(frame, leaf, quotients) & used;
    } else {
      return woop_filter(frame, leaf, begin_of<kMode>(tnear), end_of<kMode>(tfar)) & used;
    }
  }

  // Of the `candidates` of a leaf. True: no other hit is wanted.
  bool decide_leaf(const ExpandedContext& context, const LeafRows& leaf, unsigned candidates,
                   const Quotients& quotients) {
    for (unsigned mask = candidates; mask != 0; mask &= mask - 1) {
      const int i = std::countr_zero(mask);
      const Corners corners = leaf.triangle(i);
      Candidate hit;
      if constexpr (kMode == Mode::watertight) {
        if (!woop_decide<kQuery>(frame, corners, hit)) {
          continue;
        }
      } else if constexpr (kMode == Mode::exact) {
        if (!exact_decide<kQuery>(frame, corners, {tnear, tfar, kQuery != Query::all && has_hit}, hit)) {
          continue;
        }
      } else {
        hit = {quotients.t[i], quotients.u[i], quotients.v[i]};
      }
      if (offer(hit, corners, leaf, static_cast<std::uint32_t>(i), context)) {
        return true;
      }
    }
    return false;
  }

  // Where the ids of the hit stand.
  [[nodiscard]] const float* hit_ids() const { return hit_leaf.rows + kCornerRows * hit_leaf.count + hit_triangle; }

  void report_ids() {
    if (hit_leaf.rows != nullptr) {
      const PrimitiveIds ids = ids_of(hit_leaf, hit_triangle);
      answer->geometry_id = ids.geometry_id;
      answer->primitive_id = ids.primitive_id;
    }
  }

 private:
  static PrimitiveIds ids_of(const LeafRows& leaf, std::uint32_t triangle) {
    const float* ids = leaf.rows + kCornerRows * leaf.count + triangle;
    return {std::bit_cast<std::uint32_t>(ids[leaf.count]), std::bit_cast<std::uint32_t>(ids[0])};
  }

  [[nodiscard]] std::size_t index_in(const ExpandedContext& context) const {
    return static_cast<std::size_t>(answer - context.answers);
  }
  [[nodiscard]] bool drops(const ExpandedContext& context, const PrimitiveIds& ids) const {
    const std::size_t index = index_in(context);
    return context.filter->drops(context.extras.skipped.empty() ? PrimitiveIds() : context.extras.skipped[index],
                                 context.extras.masks.empty() ? kAllMask : context.extras.masks[index], ids);
  }

  bool offer(const Candidate& hit, const Corners& corners, const LeafRows& leaf, std::uint32_t triangle,
             const ExpandedContext& context) {
    float t = 0;
    if (!place_hit<kMode>(frame, corners, hit, tnear, tfar, t)) {
      return false;
    }
    if (context.filter != nullptr && drops(context, ids_of(leaf, triangle))) {
      return false;
    }
    if constexpr (kQuery == Query::any) {
      answer->t = 0;
      has_hit = true;
      return true;
    } else if constexpr (kQuery == Query::all) {
      ++answer->count;
      if (context.crossings != nullptr) {
        context.crossings->add(crossing_of(context.numbers[index_in(context)], t, hit, ids_of(leaf, triangle),
                                           context.need_normal ? normal_of(corners) : std::array<float, 3>{}));
      }
      return false;
    } else {
      if (t == tfar && has_hit && !wins_tie(corners, leaf, triangle)) {
        return false;
      }
      tfar = t;
      hit_leaf = leaf;
      hit_triangle = triangle;
      has_hit = true;
      answer->t = t;
      set_barycentrics(*answer, hit);
      if (context.need_normal) {
        answer->normal = normal_of(corners);
      }
      if constexpr (kMode == Mode::exact) {
        hit_corners = corners;
      }
      return false;
    }
  }

  // Against the best so far, at equal t: in mode exact by t before it was rounded, then by the ids.
  [[nodiscard]] bool wins_tie(const Corners& corners, const LeafRows& leaf, std::uint32_t triangle) const {
    if constexpr (kMode == Mode::exact) {
      const int order = exact_order({frame.org, frame.dir}, corners, hit_corners);
      if (order != 0) {
        return order < 0;
      }
    }
    const PrimitiveIds best = hit_leaf.rows != nullptr ? ids_of(hit_leaf, hit_triangle)
                                                       : PrimitiveIds{answer->geometry_id, answer->primitive_id};
    return ids_of(leaf, triangle) < best;
  }
};

}  // namespace raymill::traversal::RAYMILL_ISA
