// The traversal kernel, compiled once per ISA. The includer defines RAYMILL_ISA and includes its simd header first.
//
// MBVH traversal after Afra & Szirmay-Kalos 2014, section 3: a ray's state is the bitstack and the place, so it can
// stop before any node.
//   visit      test a node's boxes; the mask of those hit goes to the bitstack at the node's level
//   advance    pop: the deepest level with a bit set, there the first child in the ray's octant order
//   leaf       test its triangles
//   suspend    the next node's page is not there: the ray waits for it
// Where we differ: the order is the slots' octant order, not circular from the nearest child; ghosts (copies of
// ancestors) stand in each page, so climbing never leaves it; while a ray is at work its lane remembers the nodes of
// its path (lane-inl.h).
//
// Rays are interleaved, for a step's memory is the next one's wait: each of kLanes rays makes one step of a kind, asks
// for what its next step reads, and waits its turn in the list of that step.
//
//        +------------------------------- advance ------------------------------+
//        |             |                          |                             |
//        v             v                          v                             v
//      visit    fetch: corners' indices    follow: the reference             finished -> next ray
//        |             v                          v
//        |      test: the triangles         enter: the node, or suspended -> next ray
//        +-------------+--------------------------+
#pragma once

#include <bit>
#include <limits>

#include "storage/pages/page_image.h"
#include "traversal/kernel.h"
#include "traversal/kernels/lane-inl.h"
#include "traversal/kernels/triangle-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

using storage::ExternalKind;
using storage::PageView;

// kFirst[octant][mask]: the slot of mask that comes first when slots are visited by rising slot XOR octant.
struct FirstSlotTable {
  std::uint8_t slot[8][256] = {};
  constexpr FirstSlotTable() {
    for (unsigned octant = 0; octant < 8; ++octant) {
      for (unsigned mask = 1; mask < 256; ++mask) {
        unsigned rank = 0;
        while ((mask >> (rank ^ octant) & 1) == 0) {
          ++rank;
        }
        slot[octant][mask] = static_cast<std::uint8_t>(rank ^ octant);
      }
    }
  }
};
inline constexpr FirstSlotTable kFirst;

template <int N>
unsigned first_slot(const Node<N>& node, unsigned octant, unsigned mask) {
  if constexpr (N == 4) {
    octant = (octant >> (node.order & 3) & 1) | (octant >> (node.order >> 2) & 1) << 1;
  }
  return kFirst.slot[octant][mask];
}

// The slab test of slab.h for all children of a node: those whose interval meets [tnear, tfar], and where it begins.
template <int N>
unsigned test_boxes(const Node<N>& node, const RayFrame& ray, float tnear, float tfar, std::array<float, N>& entries) {
  auto interval = NearFar<N>::broadcast(tnear, std::numeric_limits<float>::infinity());
  for (int axis = 0; axis < 3; ++axis) {
    const float scale = std::bit_cast<float>(static_cast<std::uint32_t>(node.exponent[axis] + 127) << 23);
    const auto planes = NearFar<N>::from_bytes(node.lower, node.upper, axis, (ray.octant >> axis & 1) != 0);
    interval.tighten((planes * scale + node.base[axis] - ray.org[axis]) * ray.rdir[axis]);
  }
  Floats<N> exit = interval.far();
  exit = exit + abs(exit) * Floats<N>::broadcast(kExitPad);
  interval.near().store(entries.data());
  return less_equal(interval.near(), min_keep(exit, Floats<N>::broadcast(tfar))) & node.valid;
}

inline void prefetch(const void* address) { __builtin_prefetch(address); }

// Lanes whose next step is of one kind.
template <typename L, unsigned kCapacity>
struct StepList {
  std::array<L*, kCapacity> lanes;
  unsigned count = 0;
  void add(L* lane) { lanes[count++] = lane; }
};

template <int N, bool Wide, Query kQuery, Mode kMode>
class Batch {
 public:
  Batch(KernelContext& context, std::span<RayState> rays) : context_(context), rays_(rays) {}

  void run() {
    for (RayLane& lane : lanes_) {
      take_ray(&lane);
    }
    while (next_.steps() > 0) {
      // What steps add is for the next round: their memory is on its way by then.
      const Steps now = next_;
      next_.clear();
      each(now.visit, [this](RayLane* lane) { visit(lane); });
      each(now.fetch, [this](RayLane* lane) { fetch(lane); });
      each(now.test, [this](RayLane* lane) { test_leaf(lane); });
      each(now.follow, [this](RayLane* lane) { follow(lane); });
      each(now.enter, [this](RayLane* lane) { enter(lane); });
    }
  }

 private:
  static constexpr unsigned kLanes = 24;
  using RayLane = Lane<N, Wide>;
  using List = StepList<RayLane, kLanes>;
  struct Steps {
    List visit, fetch, test, follow, enter;
    [[nodiscard]] unsigned steps() const { return visit.count + fetch.count + test.count + follow.count + enter.count; }
    void clear() { visit.count = fetch.count = test.count = follow.count = enter.count = 0; }
  };

  template <typename Step>
  static void each(const List& list, Step&& step) {
    for (unsigned i = 0; i < list.count; ++i) {
      step(list.lanes[i]);
    }
  }

  // A ray that is not done begins where it waited.
  void take_ray(RayLane* lane) {
    while (taken_ < rays_.size()) {
      RayState& ray = rays_[taken_++];
      lane->unpack(ray);
      // A pop is what follows a reference to a leaf, and what a ray that backtracks needs.
      lane->ref = {ray.page, ray.node, 0, ray.resume == Resume::enter ? ExternalKind::node : ExternalKind::leaf};
      const std::byte* image = image_of(ray.page);
      if (image != nullptr) {
        go(lane, image);
        return;
      }
    }
  }
  void finish(RayLane* lane) {
    lane->ray->tfar = lane->tfar;
    lane->ray->done = true;
    take_ray(lane);
  }
  void fail(RayLane* lane) {
    context_.corrupt = true;
    finish(lane);
  }

  [[nodiscard]] const std::byte* image_of(std::uint32_t page) const {
    return context_.images[page].load(std::memory_order_acquire);
  }

  // To lane->ref, at lane->level of the tree.
  void go(RayLane* lane, const std::byte* image) {
    Place<N>& place = lane->places[lane->level];
    place.image = image;
    place.page = lane->ref.page;
    place.node = place.node_at(lane->ref.node);
    prefetch(image);
    prefetch_node(place.node);
    next_.enter.add(lane);
  }
  static void prefetch_node(const Node<N>* node) {
    prefetch(node);
    prefetch(reinterpret_cast<const std::byte*>(node) + sizeof(Node<N>) - 1);
  }

  void enter(RayLane* lane) {
    Place<N>& place = lane->places[lane->level];
    const PageHeader& header = PageView(place.image).header();
    // The levels rise along every path, so a damaged reference can end in a wrong node but never in a cycle.
    if (lane->ref.node >= header.node_count || place.node->level != lane->level) {
      fail(lane);
      return;
    }
    if (context_.touched[place.page].load(std::memory_order_relaxed) == 0) {
      context_.touched[place.page].store(1, std::memory_order_relaxed);
    }
    place.externals = header.externals_offset;
    place.vertices = header.vertices_offset;
    place.indices = header.indices_offset;
    if (lane->ref.kind == ExternalKind::node) {
      visit(lane);
    } else {
      measure(lane, lane->level);
      advance(lane);
    }
  }

  void visit(RayLane* lane) {
    ++context_.counters.nodes_visited;
    const unsigned level = lane->level;
    lane->set_mask(
        level, test_boxes<N>(*lane->places[level].node, lane->frame, lane->tnear, lane->tfar, lane->entries[level]));
    advance(lane);
  }

  // Chooses the next pending child and asks for its memory.
  void advance(RayLane* lane) {
    while (lane->levels != 0) {
      const auto level = static_cast<unsigned>(std::bit_width(lane->levels)) - 1;
      if (level < lane->top && !climb(lane, level)) {
        fail(lane);
        return;
      }
      const Place<N>& place = lane->places[level];
      const Node<N>& node = *place.node;
      const unsigned mask = lane->masks[level];
      const unsigned slot = first_slot<N>(node, lane->frame.octant, mask);
      const unsigned rest = mask & ~(1U << slot);
      lane->masks[level] = static_cast<std::uint8_t>(rest);
      lane->levels ^= static_cast<std::uint32_t>(rest == 0) << level;
      // Too far: what was hit since the mask was made lies before the child's box.
      if (!(lane->entries[level][slot] <= lane->tfar)) {
        continue;
      }
      lane->level = level;
      lane->slot = slot;
      if ((node.leaf >> slot & 1) != 0) {
        const std::byte* corners = place.image + place.indices + node.child[slot] * 3 * sizeof(std::uint16_t);
        prefetch(corners);
        prefetch(corners + node.count[slot] * 3 * sizeof(std::uint16_t) - 1);
        next_.fetch.add(lane);
      } else if ((node.external >> slot & 1) != 0) {
        prefetch(place.template at<ExternalRef>(place.externals) + node.child[slot]);
        next_.follow.add(lane);
      } else if ((node.valid >> slot & 1) != 0) {
        Place<N>& child = lane->places[level + 1];
        child = place;
        child.node = place.node_at(node.child[slot]);
        lane->level = level + 1;
        prefetch_node(child.node);
        next_.visit.add(lane);
      } else {
        fail(lane);
      }
      return;
    }
    finish(lane);
  }

  // A pop comes to a level above the node where the ray was taken up.
  bool climb(RayLane* lane, unsigned level) {
    Place<N> place = lane->places[lane->top];
    while (place.node->level > level) {
      place.node = place.node_at(place.node->parent);
    }
    if (place.node->level != level) {
      return false;
    }
    lane->places[level] = place;
    lane->top = level;
    measure(lane, level);
    return true;
  }

  // The entry distances of a node whose mask came with the ray.
  static void measure(RayLane* lane, unsigned level) {
    test_boxes<N>(*lane->places[level].node, lane->frame, lane->tnear, lane->tfar, lane->entries[level]);
  }

  // A reference to another page or to a treelet of this one.
  void follow(RayLane* lane) {
    const Place<N>& place = lane->places[lane->level];
    lane->ref = place.template at<ExternalRef>(place.externals)[place.node->child[lane->slot]];
    Resume resume = Resume::enter;
    if (lane->ref.kind == ExternalKind::leaf) {
      // The leaf hangs on the very node whose mask this is: the bit goes back and a pop finds it there.
      lane->set_mask(lane->level, lane->masks[lane->level] | 1U << lane->ref.slot);
      resume = Resume::backtrack;
    } else {
      ++lane->level;
    }
    const std::byte* image = image_of(lane->ref.page);
    if (image == nullptr) {
      lane->pack(resume, lane->ref.page, lane->ref.node);
      take_ray(lane);
      return;
    }
    go(lane, image);
  }

  // The corners' indices have come: asks for the corners.
  void fetch(RayLane* lane) {
    const Place<N>& place = lane->places[lane->level];
    const std::uint32_t count = place.node->count[lane->slot];
    const auto* indices = place.template at<std::uint16_t>(place.indices) + place.node->child[lane->slot] * 3;
    LeafBlock& leaf = lane->leaf;
    leaf.vertices = place.template at<float>(place.vertices);
    corner_indices(indices, count, leaf.index);
    for (const auto& corners : leaf.index) {
      for (const std::int32_t at : corners) {
        prefetch(leaf.vertices + at);
      }
    }
    next_.test.add(lane);
  }

  void test_leaf(RayLane* lane) {
    const Place<N>& place = lane->places[lane->level];
    const std::uint32_t first = place.node->child[lane->slot];
    const std::uint32_t count = place.node->count[lane->slot];
    context_.counters.triangles_tested += count;
    const LeafBlock& leaf = lane->leaf;
    const unsigned used = (1U << count) - 1;
    if constexpr (kMode == Mode::watertight) {
      for (unsigned mask = woop_filter(lane->frame, leaf) & used; mask != 0; mask &= mask - 1) {
        const int i = std::countr_zero(mask);
        const Corners corners = corners_of(leaf, i);
        Candidate hit;
        if (woop_decide(lane->frame, corners, hit) &&
            offer(lane, hit, corners, first + static_cast<std::uint32_t>(i))) {
          finish(lane);
          return;
        }
      }
    } else {
      const MoellerTrumbore result = moeller_trumbore(lane->frame, leaf);
      for (unsigned mask = result.hits & used; mask != 0; mask &= mask - 1) {
        const int i = std::countr_zero(mask);
        if (offer(lane, {result.t[i], result.u[i], result.v[i]}, corners_of(leaf, i),
                  first + static_cast<std::uint32_t>(i))) {
          finish(lane);
          return;
        }
      }
    }
    advance(lane);
  }

  // Takes the hit if it lies in the interval and before the best so far: by t, then geometry id, then primitive id.
  // True: no other hit is wanted.
  bool offer(RayLane* lane, const Candidate& hit, const Corners& corners, std::uint32_t triangle) {
    const Interval box = triangle_interval(lane->frame, corners);
    if (!(box.entry <= box.exit)) {
      return false;
    }
    float t = static_cast<float>(hit.t);
    t = t < box.entry ? box.entry : t;
    t = t > box.exit ? box.exit : t;
    if (!(t >= lane->tnear && t <= lane->tfar)) {
      return false;
    }
    RayState& ray = *lane->ray;
    if constexpr (kQuery == Query::any) {
      ray.hit = {};
      ray.hit.t = 0;
      ray.improved = ray.has_hit = true;
      return true;
    } else {
      const PageView view(lane->places[lane->level].image);
      const std::uint32_t geometry_id = view.geometry_id(triangle);
      const std::uint32_t primitive_id = view.primitive_ids()[triangle];
      if (t == lane->tfar && ray.has_hit && !comes_before(ray, geometry_id, primitive_id)) {
        return false;
      }
      lane->tfar = t;
      ray.improved = ray.has_hit = true;
      ray.hit.t = t;
      set_barycentrics(ray.hit, hit);
      ray.hit.geometry_id = geometry_id;
      ray.hit.primitive_id = primitive_id;
      if (context_.need_normal) {
        ray.hit.normal = normal_of(corners);
      }
      return false;
    }
  }

  // At equal t. The best so far may have been found before the ray last waited: its ids are then in the row.
  bool comes_before(const RayState& ray, std::uint32_t geometry_id, std::uint32_t primitive_id) const {
    const Hit best = ray.improved ? ray.hit : context_.rows->layout.read(context_.rows->row(ray.number));
    return geometry_id < best.geometry_id || (geometry_id == best.geometry_id && primitive_id < best.primitive_id);
  }

  KernelContext& context_;
  const std::span<RayState> rays_;
  std::size_t taken_ = 0;
  Steps next_;
  std::array<RayLane, kLanes> lanes_;
};

template <int N, bool Wide, Query kQuery, Mode kMode>
void trace_batch(KernelContext& context, std::span<RayState> rays) {
  Batch<N, Wide, kQuery, kMode>(context, rays).run();
}

template <int N, bool Wide, Query kQuery>
Kernel select_mode(Mode mode) {
  return mode == Mode::watertight ? &trace_batch<N, Wide, kQuery, Mode::watertight>
                                  : &trace_batch<N, Wide, kQuery, Mode::fast>;
}

template <int N, bool Wide>
Kernel select_query(const KernelChoice& choice) {
  return choice.query == Query::closest ? select_mode<N, Wide, Query::closest>(choice.mode)
                                        : select_mode<N, Wide, Query::any>(choice.mode);
}

template <int N>
Kernel select_stack(const KernelChoice& choice) {
  return choice.wide_stack ? select_query<N, true>(choice) : select_query<N, false>(choice);
}

inline Kernel select_kernel(const KernelChoice& choice) {
  return choice.width == 8 ? select_stack<8>(choice) : select_stack<4>(choice);
}

}  // namespace raymill::traversal::RAYMILL_ISA
