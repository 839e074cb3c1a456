// Packets: coherent rays that go through the expanded layout together, compiled once per ISA. The includer defines
// RAYMILL_ISA and includes its simd header first.
//
// A node is visited once for all rays of a packet, by intervals (Boulos, Wald, Shirley 2006, "Geometric and arithmetic
// culling methods for entire ray packets"): of the packet's origins and reciprocal directions only the least and the
// greatest stand in the box test. At a leaf each ray first meets the leaf's box on its own, eight rays a step, then its
// triangles.
//
// No ray misses a box that it would meet alone: plane - org and its product with rdir are monotone in org and rdir, bit
// for bit, so the least of a packet's products is no later than any ray's entry, the greatest no earlier than any ray's
// exit; padding is monotone too (slab.h). That rays meet boxes more often than alone changes no answer.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "traversal/kernels/expanded_ray-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

constexpr std::size_t kPacketRays = 16;  // measured: speed.md

/// What of a packet's rays stands in its box tests: the least and the greatest of each of their numbers.
struct PacketBounds {
  // As they stand in a ray: org, tnear, dir, tfar.
  static constexpr std::size_t kTnear = 3, kDir = 4, kTfar = 7;
  alignas(32) std::array<float, 8> least, most;

  explicit PacketBounds(std::span<const Ray, kPacketRays> rays) {
    static_assert(offsetof(Ray, org) == 0 && offsetof(Ray, dir) == kDir * sizeof(float) &&
                  offsetof(Ray, tnear) == kTnear * sizeof(float) && offsetof(Ray, tfar) == kTfar * sizeof(float));
    Float8 low = Float8::load(rays[0].org.data()), high = low;
    for (const Ray& ray : rays.template subspan<1>()) {
      const Float8 numbers = Float8::load(ray.org.data());
      low = min_keep(numbers, low);
      high = max_keep(numbers, high);
    }
    low.store(least.data());
    high.store(most.data());
  }

  // Whether the rays have so much in common that they visit few nodes together that they would not visit alone:
  // directions in one octant, none of their components zero, and within an eighth of their length; origins within
  // `width` of each other.
  [[nodiscard]] bool coherent(float width) const {
    constexpr float kSpread = 1.0F / 8, kLeastDir = 0x1p-120F;
    float length = 0, spread = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float low = least[kDir + axis], high = most[kDir + axis];
      if (!(most[axis] - least[axis] <= width && (low >= kLeastDir || high <= -kLeastDir))) {
        return false;
      }
      length = std::max({length, high, -low});
      spread = std::max(spread, high - low);
    }
    return spread <= length * kSpread;
  }
};

template <int N, Query kQuery, Mode kMode>
class ExpandedPacket {
 public:
  static constexpr std::size_t kRays = kPacketRays;

  ExpandedPacket(ExpandedContext& context, std::span<const Ray, kRays> rays, std::span<Hit, kRays> hits,
                 const PacketBounds& bounds)
      : context_(context),
        nodes_(static_cast<const ExpandedNode<N>*>(context.tree.nodes)),
        blocks_(context.tree.blocks),
        rays_(rays),
        hits_(hits),
        begin_(begin_of<kMode>(bounds.least[PacketBounds::kTnear])),
        end_(end_of<kMode>(std::min(bounds.most[PacketBounds::kTfar], std::numeric_limits<float>::max()))) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      // 1 / x falls where x rises, and rounding keeps that.
      const float least_dir = bounds.least[PacketBounds::kDir + axis],
                  most_dir = bounds.most[PacketBounds::kDir + axis];
      const bool negative = most_dir < 0;
      octant_ |= static_cast<unsigned>(negative) << axis;
      near_org_[axis] = negative ? bounds.least[axis] : bounds.most[axis];
      far_org_[axis] = negative ? bounds.most[axis] : bounds.least[axis];
      least_rdir_[axis] = 1.0F / most_dir;
      most_rdir_[axis] = 1.0F / least_dir;
    }
    if constexpr (kMode == Mode::exact) {
      prepare_exact();
    }
  }

  // False: the rays share too little. They are to start anew, each on its own, with the hits that they have.
  bool run() {
    path_[0] = nodes_ + context_.tree.root;
    visit(0);
    while (levels_ != 0) {
      const auto level = static_cast<unsigned>(std::bit_width(levels_)) - 1;
      const ExpandedNode<N>& node = *path_[level];
      const unsigned mask = masks_[level];
      const unsigned slot = first_slot<N>(node, octant_, mask);
      masks_[level] = static_cast<std::uint8_t>(mask & ~(1U << slot));
      levels_ ^= static_cast<std::uint32_t>((mask & (mask - 1)) == 0) << level;
      if (!(entries_[level][slot] <= end_)) {
        continue;
      }
      if (node.count[slot] == 0) {
        path_[level + 1] = nodes_ + node.child[slot];
        visit(level + 1);
      } else {
        meet_leaf(node, slot);
        if (leaves_met_ >= kTriedLeaves && rays_met_ < kLeastShare * leaves_met_) {
          give_up();
          return false;
        }
      }
    }
    if (is_separate_) {
      for (auto& ray : separate_) {
        ray.report_ids();
      }
    }
    return true;
  }

 private:
  static constexpr unsigned kLevels = storage::kBitstackBits / N;
  static constexpr std::size_t kGroup = 8;
  // After so many leaves so many rays must have met each of them, in the mean.
  static constexpr unsigned kTriedLeaves = 8, kLeastShare = 2;

  // Every hit stays but those of mode exact, of which more would have to be known than the answer holds.
  void give_up() {
    for (std::size_t i = 0; i < kRays; ++i) {
      separate_[i].report_ids();
      if (kMode == Mode::exact && kQuery == Query::closest) {
        hits_[i] = {};
      }
    }
  }

  // Everything counts in halves, and an axis that is not reliable for one ray gives no constraint for any
  // (exact-inl.h).
  void prepare_exact() {
    for (const Ray& ray : rays_) {
      RayFrame frame = make_frame(ray.org, ray.dir);
      prepare_exact_boxes(frame);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        most_rdir_[axis] = std::isnan(frame.rdir[axis]) ? frame.rdir[axis] : most_rdir_[axis];
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      least_rdir_[axis] = std::isnan(most_rdir_[axis]) ? most_rdir_[axis] : 0.5F * least_rdir_[axis];
      most_rdir_[axis] = 0.5F * most_rdir_[axis];
    }
  }

  // For the first leaf: what each ray meets boxes with.
  void separate() {
    for (std::size_t i = 0; i < kRays; ++i) {
      auto& ray = separate_[i];
      ray.begin(rays_[i], hits_[i]);
      begins_[i] = begin_of<kMode>(ray.tnear);
      ends_[i] = end_of<kMode>(ray.tfar);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        org_[axis][i] = ray.frame.org[axis];
        rdir_[axis][i] = ray.frame.rdir[axis];
      }
    }
    is_separate_ = true;
  }

  // The packet's interval in each child's box.
  void visit(unsigned level) {
    const ExpandedNode<N>& node = *path_[level];
    auto near = Floats<N>::broadcast(begin_);
    auto far = Floats<N>::broadcast(std::numeric_limits<float>::infinity());
    for (int axis = 0; axis < 3; ++axis) {
      const unsigned negative = octant_ >> axis & 1;
      const auto least = Floats<N>::broadcast(least_rdir_[axis]), most = Floats<N>::broadcast(most_rdir_[axis]);
      const auto to_near = Floats<N>::load(node.planes[axis][negative].data()) - Floats<N>::broadcast(near_org_[axis]);
      const auto to_far =
          Floats<N>::load(node.planes[axis][negative ^ 1].data()) - Floats<N>::broadcast(far_org_[axis]);
      near = max_keep(min_keep(to_near * least, to_near * most), near);
      far = min_keep(max_keep(to_far * least, to_far * most), far);
    }
    far = far + abs(far) * Floats<N>::broadcast(kExitPad);
    if constexpr (kMode == Mode::exact) {
      far = far + Floats<N>::broadcast(kExactSlack);
    }
    near.store(entries_[level].data());
    const unsigned mask = less_equal(near, min_keep(Floats<N>::broadcast(end_), far)) & node.valid;
    masks_[level] = static_cast<std::uint8_t>(mask);
    levels_ |= static_cast<std::uint32_t>(mask != 0) << level;
    ++context_.counters.nodes_visited;
    for (unsigned rest = mask; rest != 0; rest &= rest - 1) {
      const auto slot = static_cast<unsigned>(std::countr_zero(rest));
      const void* wanted = node.count[slot] != 0 ? static_cast<const void*>(blocks_ + node.child[slot])
                                                 : static_cast<const void*>(nodes_ + node.child[slot]);
      __builtin_prefetch(wanted);
      __builtin_prefetch(static_cast<const std::byte*>(wanted) + 64);
    }
  }

  // Rays of a group of eight that meet the box in `slot`, each by its own numbers.
  unsigned meet_box(const ExpandedNode<N>& node, unsigned slot, std::size_t first) const {
    auto near = Float8::load(&begins_[first]);
    auto far = Float8::broadcast(std::numeric_limits<float>::infinity());
    for (int axis = 0; axis < 3; ++axis) {
      const unsigned negative = octant_ >> axis & 1;
      const auto org = Float8::load(&org_[axis][first]), rdir = Float8::load(&rdir_[axis][first]);
      near = max_keep((Float8::broadcast(node.planes[axis][negative][slot]) - org) * rdir, near);
      far = min_keep((Float8::broadcast(node.planes[axis][negative ^ 1][slot]) - org) * rdir, far);
    }
    far = far + abs(far) * Float8::broadcast(kExitPad);
    if constexpr (kMode == Mode::exact) {
      far = far + Float8::broadcast(kExactSlack);
    }
    return less_equal(near, min_keep(Float8::load(&ends_[first]), far));
  }

  void meet_leaf(const ExpandedNode<N>& node, unsigned slot) {
    const LeafRows leaf{blocks_ + node.child[slot], node.count[slot]};
    bool is_nearer = false;
    ++leaves_met_;
    if (!is_separate_) {
      separate();
    }
    for (std::size_t first = 0; first < kRays; first += kGroup) {
      for (unsigned mask = meet_box(node, slot, first); mask != 0; mask &= mask - 1) {
        ++rays_met_;
        const std::size_t i = first + static_cast<unsigned>(std::countr_zero(mask));
        auto& ray = separate_[i];
        Quotients quotients;
        const unsigned candidates = ray.filter_leaf(leaf, quotients);
        context_.counters.triangles_tested += leaf.count;
        if (candidates == 0) {
          continue;
        }
        const bool is_done = ray.decide_leaf(context_, leaf, candidates, quotients);
        // Nothing is before an end at -infinity.
        ends_[i] = is_done ? -std::numeric_limits<float>::infinity() : end_of<kMode>(ray.tfar);
        is_nearer = true;
      }
    }
    if (is_nearer) {
      end_ = *std::max_element(ends_.begin(), ends_.end());
    }
  }

  ExpandedContext& context_;
  const ExpandedNode<N>* const nodes_;
  const float* const blocks_;
  const std::span<const Ray, kRays> rays_;
  const std::span<Hit, kRays> hits_;
  unsigned octant_ = 0;
  unsigned leaves_met_ = 0, rays_met_ = 0;
  bool is_separate_ = false;  // the arrays below hold the rays
  float begin_, end_;
  std::array<float, 3> near_org_, far_org_, least_rdir_, most_rdir_;
  std::uint32_t levels_ = 0;
  std::array<std::uint8_t, kLevels> masks_;
  std::array<const ExpandedNode<N>*, kLevels + 1> path_;
  std::array<std::array<float, N>, kLevels> entries_;
  alignas(32) std::array<std::array<float, kRays>, 3> org_, rdir_;
  alignas(32) std::array<float, kRays> begins_, ends_;
  std::array<ExpandedRay<kQuery, kMode>, kRays> separate_;
};

}  // namespace raymill::traversal::RAYMILL_ISA
