// The traversal kernel, compiled once per ISA. The includer defines RAYMILL_ISA and includes its simd header first.
//
// Stackless MBVH traversal after Afra & Szirmay-Kalos 2014, section 3: the only state is the bitstack and the place.
//   visit      test a node's boxes; the mask of those hit goes to the bitstack at the node's level
//   pop        the deepest level with a bit set; climb to the node of that level by parent links
//   leaf       test its triangles
//   suspend    the next node's page is not there: the ray waits for it
// Where we differ: the order is the slots' octant order, not circular from the nearest child; ghosts (copies of
// ancestors) stand in each page, so climbing never leaves it.
#pragma once

#include <bit>
#include <limits>

#include "storage/pages/page_image.h"
#include "traversal/kernel.h"
#include "traversal/kernels/triangle-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

using storage::ExternalKind;
using storage::ExternalRef;
using storage::Node;
using storage::PageView;

// Bitstack in one word or two.
template <int N, bool Wide>
class Stack {
 public:
  explicit Stack(Bitstack& bits) : bits_(bits) {}

  void set(unsigned level, unsigned mask) {
    if constexpr (Wide) {
      bits_.words[level / kLevelsPerWord] |= std::uint64_t(mask) << (level % kLevelsPerWord * N);
    } else {
      bits_.words[0] |= std::uint64_t(mask) << (level * N);
    }
  }
  void clear(unsigned level, unsigned slot) {
    bits_.words[level / kLevelsPerWord] &= ~(std::uint64_t(1) << (level % kLevelsPerWord * N + slot));
  }
  [[nodiscard]] unsigned mask(unsigned level) const {
    return static_cast<unsigned>(bits_.words[level / kLevelsPerWord] >> (level % kLevelsPerWord * N)) & ((1U << N) - 1);
  }
  /// Deepest level with a bit set, or -1.
  [[nodiscard]] int deepest() const {
    if constexpr (Wide) {
      if (bits_.words[1] != 0) {
        return kLevelsPerWord + (63 - std::countl_zero(bits_.words[1])) / N;
      }
    }
    return bits_.words[0] == 0 ? -1 : (63 - std::countl_zero(bits_.words[0])) / N;
  }

 private:
  static constexpr int kLevelsPerWord = 64 / N;
  Bitstack& bits_;
};

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

// The slab test of slab.h for all children of a node: those whose interval meets [tnear, tfar].
template <int N>
unsigned test_boxes(const Node<N>& node, const RayFrame& ray, float tnear, float tfar) {
  using Lanes = Floats<N>;
  Lanes entry = Lanes::broadcast(tnear);
  Lanes exit = Lanes::broadcast(std::numeric_limits<float>::infinity());
  for (int axis = 0; axis < 3; ++axis) {
    const bool negative = (ray.octant >> axis & 1) != 0;
    const auto& near_q = negative ? node.upper[axis] : node.lower[axis];
    const auto& far_q = negative ? node.lower[axis] : node.upper[axis];
    const Lanes base = Lanes::broadcast(node.base[axis]);
    const Lanes scale =
        Lanes::broadcast(std::bit_cast<float>(static_cast<std::uint32_t>(node.exponent[axis] + 127) << 23));
    const Lanes org = Lanes::broadcast(ray.org[axis]);
    const Lanes rdir = Lanes::broadcast(ray.rdir[axis]);
    const Lanes near = (base + Lanes::from_bytes(near_q.data()) * scale - org) * rdir;
    const Lanes far = (base + Lanes::from_bytes(far_q.data()) * scale - org) * rdir;
    entry = max_keep(near, entry);
    exit = min_keep(far, exit);
  }
  exit = exit + abs(exit) * Lanes::broadcast(kExitPad);
  return less_equal(entry, min_keep(exit, Lanes::broadcast(tfar))) & node.valid;
}

template <int N, bool Wide, Query kQuery, Mode kMode>
class Tracer {
 public:
  Tracer(KernelContext& context, RayState& ray)
      : context_(context), ray_(ray), frame_(make_frame(ray.org, ray.dir)), stack_(ray.stack) {}

  void run() {
    if (!enter_page(ray_.page, ray_.node)) {
      return;
    }
    if (ray_.resume == Resume::enter) {
      visit();
    }
    while (!ray_.done && pop()) {
    }
  }

 private:
  const Node<N>& node() const { return nodes_[at_]; }

  // Makes the page of the next node current; false: it is not resident, the ray waits for it.
  bool enter_page(std::uint32_t page, std::uint32_t node) {
    const std::byte* image = context_.images[page].load(std::memory_order_acquire);
    if (image == nullptr) {
      ray_.left = {image_, ray_.page, static_cast<std::uint16_t>(at_)};
    }
    ray_.page = page;
    ray_.node = static_cast<std::uint16_t>(node);
    if (image == nullptr) {
      return false;
    }
    if (context_.touched[page].load(std::memory_order_relaxed) == 0) {
      context_.touched[page].store(1, std::memory_order_relaxed);
    }
    image_ = image;
    nodes_ = PageView(image).nodes<N>();
    at_ = node;
    // The levels rise along every path, so a damaged reference can end in a wrong node but never in a cycle.
    return (node < PageView(image).header().node_count && nodes_[node].level == ray_.level) || fail();
  }

  bool fail() {
    context_.corrupt = true;
    ray_.done = true;
    return false;
  }

  void visit() {
    ++context_.counters.nodes_visited;
    const unsigned hits = test_boxes<N>(node(), frame_, ray_.tnear, ray_.tfar);
    stack_.set(node().level, hits);
  }

  // Goes to the next pending child. False: the ray is done or waits.
  bool pop() {
    const int level = stack_.deepest();
    if (level < 0) {
      ray_.done = true;
      return false;
    }
    while (node().level > level) {
      at_ = node().parent;
    }
    if (node().level != level) {
      return fail();
    }
    const unsigned slot = first_slot<N>(node(), frame_.octant, stack_.mask(static_cast<unsigned>(level)));
    stack_.clear(static_cast<unsigned>(level), slot);
    const unsigned bit = 1U << slot;
    if ((node().leaf & bit) != 0) {
      test_leaf(node().child[slot], node().count[slot]);
      return !ray_.done;
    }
    if ((node().external & bit) != 0) {
      return leave_page(static_cast<unsigned>(level), slot);
    }
    if ((node().valid & bit) == 0) {
      return fail();
    }
    at_ = node().child[slot];
    visit();
    return true;
  }

  // Follows a reference to another page (or to a treelet of this one).
  bool leave_page(unsigned level, unsigned slot) {
    // Too far: what was hit since the mask was made may lie before the child's box. Nothing is read for it then.
    if ((test_boxes<N>(node(), frame_, ray_.tnear, ray_.tfar) >> slot & 1) == 0) {
      return true;
    }
    const ExternalRef ref = PageView(image_).externals()[node().child[slot]];
    if (ref.kind == ExternalKind::leaf) {
      // The leaf hangs on the very node whose mask this is: the bit goes back and backtracking finds it there.
      stack_.set(level, 1U << ref.slot);
      ray_.resume = Resume::backtrack;
      ray_.level = static_cast<std::uint8_t>(level);
      return enter_page(ref.page, ref.node);
    }
    ray_.resume = Resume::enter;
    ray_.level = static_cast<std::uint8_t>(level + 1);
    if (!enter_page(ref.page, ref.node)) {
      return false;
    }
    visit();
    return true;
  }

  void test_leaf(std::uint32_t first, std::uint32_t count) {
    context_.counters.triangles_tested += count;
    const PageView view(image_);
    const std::uint16_t* indices = view.indices() + std::size_t(first) * 3;
    LeafBlock leaf{&view.vertices()[0].x, {}};
    for (std::uint32_t i = 0; i < 8; ++i) {
      const std::uint32_t lane = i < count ? i : 0;
      for (int k = 0; k < 3; ++k) {
        leaf.index[k][i] = indices[lane * 3 + k] * 3;
      }
    }
    const unsigned lanes = (1U << count) - 1;
    if constexpr (kMode == Mode::watertight) {
      for (unsigned mask = woop_filter(frame_, leaf) & lanes; mask != 0 && !ray_.done; mask &= mask - 1) {
        const int lane = std::countr_zero(mask);
        const Corners corners = corners_of(leaf, lane);
        Candidate hit;
        if (woop_decide(frame_, corners, hit)) {
          offer(hit, corners, first + static_cast<std::uint32_t>(lane));
        }
      }
    } else {
      const MoellerTrumbore result = moeller_trumbore(frame_, leaf);
      for (unsigned mask = result.hits & lanes; mask != 0 && !ray_.done; mask &= mask - 1) {
        const int lane = std::countr_zero(mask);
        offer({result.t[lane], result.u[lane], result.v[lane]}, corners_of(leaf, lane),
              first + static_cast<std::uint32_t>(lane));
      }
    }
  }

  // Takes the hit if it lies in the interval and before the best so far: by t, then geometry id, then primitive id.
  void offer(const Candidate& hit, const Corners& corners, std::uint32_t triangle) {
    const Interval box = triangle_interval(frame_, corners);
    if (!(box.entry <= box.exit)) {
      return;
    }
    float t = static_cast<float>(hit.t);
    t = t < box.entry ? box.entry : t;
    t = t > box.exit ? box.exit : t;
    if (!(t >= ray_.tnear && t <= ray_.tfar)) {
      return;
    }
    if constexpr (kQuery == Query::any) {
      ray_.hit = {};
      ray_.hit.t = 0;
      ray_.has_hit = ray_.done = true;
    } else {
      const PageView view(image_);
      const std::uint32_t geometry_id = view.geometry_id(triangle);
      const std::uint32_t primitive_id = view.primitive_ids()[triangle];
      if (t == ray_.tfar && ray_.has_hit && !comes_before(geometry_id, primitive_id)) {
        return;
      }
      ray_.tfar = t;
      ray_.has_hit = true;
      ray_.hit.t = t;
      set_barycentrics(hit);
      ray_.hit.geometry_id = geometry_id;
      ray_.hit.primitive_id = primitive_id;
      if (context_.need_normal) {
        set_normal(corners);
      }
    }
  }

  // At equal t.
  [[nodiscard]] bool comes_before(std::uint32_t geometry_id, std::uint32_t primitive_id) const {
    const Hit& best = ray_.hit;
    return geometry_id < best.geometry_id || (geometry_id == best.geometry_id && primitive_id < best.primitive_id);
  }

  // Inside by the signs; the quotients may stick out by a rounding.
  void set_barycentrics(const Candidate& hit) {
    const auto clamp = [](float x) { return x < 0.0F ? 0.0F : x > 1.0F ? 1.0F : x; };
    ray_.hit.u = clamp(static_cast<float>(hit.u));
    const float v = clamp(static_cast<float>(hit.v));
    ray_.hit.v = ray_.hit.u + v > 1.0F ? 1.0F - ray_.hit.u : v;
  }

  void set_normal(const Corners& corners) {
    std::array<double, 3> e1, e2;
    for (int axis = 0; axis < 3; ++axis) {
      e1[axis] = double(corners[1][axis]) - corners[0][axis];
      e2[axis] = double(corners[2][axis]) - corners[0][axis];
    }
    const std::array<double, 3> n{e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2],
                                  e1[0] * e2[1] - e1[1] * e2[0]};
    const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int axis = 0; axis < 3; ++axis) {
      ray_.hit.normal[axis] = length > 0 ? static_cast<float>(n[axis] / length) : 0.0F;
    }
  }

  KernelContext& context_;
  RayState& ray_;
  const RayFrame frame_;
  Stack<N, Wide> stack_;
  const std::byte* image_ = nullptr;
  const Node<N>* nodes_ = nullptr;
  std::uint32_t at_ = 0;
};

template <int N, bool Wide, Query kQuery, Mode kMode>
void trace_batch(KernelContext& context, std::span<RayState> rays) {
  for (RayState& ray : rays) {
    Tracer<N, Wide, kQuery, kMode>(context, ray).run();
  }
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
