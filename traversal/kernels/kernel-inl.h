// The traversal kernel, compiled once per ISA. The includer defines RAYMILL_ISA and includes its simd header first.
//
// MBVH traversal after Afra & Szirmay-Kalos 2014, section 3: a ray's state is the bitstack and the place, so it can
// stop before any node.
//   visit      test a node's boxes; the mask of those hit goes to the bitstack at the node's level
//   advance    pop: the deepest level with a bit set, there the first child in the ray's octant order
//   leaf       test its triangles
//   suspend    the next node's page is not there: the ray waits for it
// Where we differ: the order is the slots' octant order, not circular from the nearest child, and siblings that are
// there come before one that is not; ghosts (copies of ancestors) stand in each page, so climbing never leaves it;
// while a ray is at work its lane remembers the nodes of its path (lane-inl.h).
//
// Rays are interleaved, for a step's memory is the next one's wait: each of kLanes rays makes one step, asks for what
// its next step reads, and waits its turn in the list of that step.
//
//        +------------------------------- advance ------------------------------+
//        |             |                          |                             |
//        v             v                          v                             v
//      visit    fetch: corners' indices    follow: the reference             finished -> next ray
//        |             v                          v
//        |      filter, decide: triangles   enter: the node, or suspended -> next ray
//        +-------------+--------------------------+
#pragma once

#include <bit>
#include <limits>
#include <utility>

#include "storage/pages/page_image.h"
#include "traversal/kernel.h"
#include "traversal/kernels/best_hit-inl.h"
#include "traversal/kernels/box_test-inl.h"
#include "traversal/kernels/climb-inl.h"
#include "traversal/kernels/exact-inl.h"
#include "traversal/kernels/instance-inl.h"
#include "traversal/kernels/lane-inl.h"
#include "traversal/kernels/proxy-inl.h"
#include "traversal/kernels/slot_order-inl.h"
#include "traversal/kernels/step_lists-inl.h"
#include "traversal/kernels/triangle-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

using storage::ExternalKind;
using storage::PageView;

inline void prefetch(const void* address) { __builtin_prefetch(address); }

/// What a ray does next. The first six wait a round for their memory; the last two are of the same round.
enum Step : unsigned { kVisit, kFetch, kFollow, kFilter, kEnter, kReport, kDecide, kAdvance, kStepCount };

template <int N, Query kQuery, Mode kMode>
class Batch {
 public:
  Batch(KernelContext& context, std::span<RayState> rays) : context_(context), rays_(rays) {}

  void run() {
    for (RayLane& lane : lanes_) {
      take_ray(&lane);
    }
    for (unsigned round = 0; !lists_[round & 1].empty(); ++round) {
      // What steps add is for the next round: their memory is on its way by then. Within a round the arithmetic of all
      // rays comes before the first branch on its results: a branch foretold wrongly then waits for nothing else.
      Lists& now = lists_[round & 1];
      now_ = &now;
      next_ = &lists_[(round + 1) & 1];
      counters_.nodes_visited += now.count[kVisit];
      counters_.pages_entered += now.count[kEnter];
      now.each(kVisit, [this](RayLane* lane) { visit(lane); });
      now.each(kEnter, [this](RayLane* lane) { enter(lane); });
      now.each(kFilter, [this](RayLane* lane) { filter_leaf(lane); });
      now.each(kFetch, [this](RayLane* lane) { fetch(lane); });
      now.each(kDecide, [this](RayLane* lane) { decide_leaf(lane); });
      now.each(kAdvance, [this](RayLane* lane) { advance(lane); });
      now.each(kFollow, [this](RayLane* lane) { follow(lane); });
      now.each(kReport, [this](RayLane* lane) { report(lane); });
    }
    context_.counters.nodes_visited += counters_.nodes_visited;
    context_.counters.triangles_tested += counters_.triangles_tested;
    context_.counters.pages_entered += counters_.pages_entered;
    context_.counters.proxies_taken += counters_.proxies_taken;
  }

 private:
  static constexpr unsigned kLanes = 24;  // measured: speed.md
  static constexpr std::uint32_t kCornersBytes = 3 * sizeof(std::uint16_t);
  static constexpr std::uint32_t kLineBytes = 64;  // neither a node nor a leaf's indices lie in more than two lines
  using RayLane = Lane<N>;
  using Lists = StepLists<RayLane, kLanes, kStepCount>;

  // A ray that is not done begins where it waited.
  void take_ray(RayLane* lane) {
    while (taken_ < rays_.size()) {
      RayState& ray = rays_[taken_++];
      if (context_.masks && ray.texel.what() == TexelWait::State::asked && !answer_texel(context_, ray)) {
        continue;
      }
      lane->unpack(ray, context_.object_level);
      ray.left_object = false;
      if constexpr (kMode == Mode::exact) {
        prepare_exact_boxes(lane->frame);
      }
      // A pop is what follows a reference to a leaf, and what a ray that backtracks needs.
      lane->ref = {ray.page, ray.node, 0, ray.resume == Resume::enter ? ExternalKind::node : ExternalKind::leaf};
      const std::byte* image = image_of(ray.page);
      if (image != nullptr) {
        go(lane, image);
        return;
      }
    }
  }
  // Nothing is pending any more.
  void finish(RayLane* lane) {
    if (lane->hit_image == nullptr) {
      report(lane);
      return;
    }
    const PageView view(lane->hit_image);
    prefetch(view.primitive_ids() + lane->hit_triangle);
    prefetch(view.geometry_index(lane->hit_triangle));
    next_->add(kReport, lane);
  }
  void report(RayLane* lane) {
    identify(*lane);
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
    next_->add(kEnter, lane);
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
      ++counters_.nodes_visited;
      visit(lane);
    } else if (measure<N, kMode>(lane, lane->level)) {
      if (context_.masks && lane->ray->texel.active()) {
        resume_leaf(lane);
      } else {
        now_->add(kAdvance, lane);
      }
    } else {
      fail(lane);
    }
  }

  [[gnu::always_inline]] void visit(RayLane* lane) {
    const unsigned level = lane->level;
    lane->set_mask(level, test_boxes<N, kMode>(*lane->places[level].node, lane->frame, lane->tnear, lane->tfar,
                                               lane->entries[level]));
    now_->add(kAdvance, lane);
  }

  // Chooses the next pending child and asks for its memory.
  [[gnu::always_inline]] void advance(RayLane* lane) {
    while (lane->levels != 0) {
      const auto level = static_cast<unsigned>(std::bit_width(lane->levels)) - 1;
      if (level < lane->top) [[unlikely]] {
        if (level < lane->floor && !leave_object(lane)) {
          return;
        }
        if (level < lane->top && !climb<N, kMode>(lane, level)) {
          fail(lane);
          return;
        }
      }
      const Place<N>& place = lane->places[level];
      const Node<N>& node = *place.node;
      const unsigned mask = lane->masks[level];
      const unsigned slot = first_slot<N>(node, lane->frame.octant, mask);
      lane->masks[level] = static_cast<std::uint8_t>(mask & ~(1U << slot));
      lane->levels ^= static_cast<std::uint32_t>((mask & (mask - 1)) == 0) << level;
      // Too far: what was hit since the mask was made lies before the child's box.
      if (!(lane->entries[level][slot] <= end_of<kMode>(lane->tfar))) {
        continue;
      }
      descend(lane, place, level, slot);
      return;
    }
    finish(lane);
  }

  // To a child of the node at `place`, at `level`. No branch on what the child is: it could not be foretold.
  [[gnu::always_inline]] void descend(RayLane* lane, const Place<N>& place, unsigned level, unsigned slot) {
    const Node<N>& node = *place.node;
    const unsigned is_leaf = node.leaf >> slot & 1, is_external = node.external >> slot & 1;
    const std::uint32_t child_index = node.child[slot];
    Place<N>& child = lane->places[level + 1];
    child = place;
    child.node = place.node_at(child_index);
    const std::byte* corners = place.image + place.indices + child_index * kCornersBytes;
    const std::byte* reference = place.image + place.externals + child_index * sizeof(ExternalRef);
    const std::byte* wanted = reinterpret_cast<const std::byte*>(child.node);
    wanted = is_leaf != 0 ? corners : wanted;
    wanted = is_external != 0 ? reference : wanted;
    prefetch(wanted);
    prefetch(wanted + kLineBytes);
    lane->level = level + ((is_leaf | is_external) ^ 1);
    lane->slot = slot;
    next_->add(is_leaf * kFetch + is_external * kFollow, lane);
  }

  // The child that is next is not there: goes on with the first sibling that is, and leaves the other pending. False:
  // there is none.
  [[gnu::noinline]] bool pass_over(RayLane* lane) {
    const unsigned level = lane->level;
    const Place<N>& place = lane->places[level];
    const Node<N>& node = *place.node;
    unsigned rest = lane->masks[level];
    while (rest != 0) {
      const unsigned slot = first_slot<N>(node, lane->frame.octant, rest);
      rest &= ~(1U << slot);
      if (!(lane->entries[level][slot] <= end_of<kMode>(lane->tfar))) {
        continue;
      }
      const bool is_external = (node.external >> slot & 1) != 0;
      if (!is_external || is_there(place, place.template at<ExternalRef>(place.externals)[node.child[slot]])) {
        lane->set_mask(level, (lane->masks[level] & ~(1U << slot)) | 1U << lane->slot);
        descend(lane, place, level, slot);
        return true;
      }
    }
    return false;
  }

  [[nodiscard]] bool is_there(const Place<N>& place, const ExternalRef& ref) const {
    const bool instance = ref.kind == ExternalKind::instance;
    return image_of(instance ? PageView(place.image).instances()[ref.page].page : ref.page) != nullptr;
  }

  // A reference to another page or to a treelet of this one.
  void follow(RayLane* lane) {
    const Place<N> place = lane->places[lane->level];
    lane->ref = place.template at<ExternalRef>(place.externals)[place.node->child[lane->slot]];
    if (lane->ref.kind >= ExternalKind::instance) [[unlikely]] {
      if (lane->ref.kind == ExternalKind::instance) {
        enter_instance(lane, place);
        return;
      }
      if (context_.footprint != nullptr && take_proxy(lane, place)) {
        return;
      }
      lane->ref.kind = ExternalKind::node;
    }
    const std::byte* image = image_of(lane->ref.page);
    if (image == nullptr && pass_over(lane)) {
      return;
    }
    Resume resume = Resume::enter;
    if (lane->ref.kind == ExternalKind::leaf) {
      // The leaf hangs on the very node whose mask this is: the bit goes back and a pop finds it there.
      lane->set_mask(lane->level, lane->masks[lane->level] | 1U << lane->ref.slot);
      resume = Resume::backtrack;
    } else {
      ++lane->level;
    }
    if (image == nullptr) {
      lane->ray->left = {place.image, place.page, static_cast<std::uint16_t>(place.node - place.node_at(0))};
      suspend(lane, resume);
      return;
    }
    go(lane, image);
  }
  void suspend(RayLane* lane, Resume resume) {
    identify(*lane);
    lane->pack(resume, lane->ref.page, lane->ref.node);
    take_ray(lane);
  }

  // What stands for the subtree that a reference leads to answers, whether its page is there or not. False: the ray
  // enters it.
  [[gnu::noinline]] bool take_proxy(RayLane* lane, const Place<N>& place) {
    const ProxyAnswer answer = ask_proxy<kQuery, kMode>(context_, *lane, place);
    if (answer == ProxyAnswer::enter) {
      return false;
    }
    ++counters_.proxies_taken;
    if (answer == ProxyAnswer::done) {
      finish(lane);
    } else {
      next_->add(kAdvance, lane);
    }
    return true;
  }

  // Into an object that hangs on the node at `place`, if the ray meets the instance's own box.
  [[gnu::noinline]] void enter_instance(RayLane* lane, const Place<N>& place) {
    const storage::Instance& instance = PageView(place.image).instances()[lane->ref.page];
    RayState& ray = *lane->ray;
    float entry = 0;
    if (!meets_box<kMode>(lane->frame, instance, lane->tnear, lane->tfar, entry)) {
      next_->add(kAdvance, lane);
      return;
    }
    const std::byte* image = image_of(instance.page);
    if (image == nullptr && pass_over(lane)) {
      return;
    }
    if (!to_object(instance.world_from_object, ray)) {
      next_->add(kAdvance, lane);
      return;
    }
    ray.object.page = place.page;
    ray.object.node = static_cast<std::uint16_t>(place.node - place.node_at(0));
    ray.object.level = static_cast<std::uint8_t>(lane->level);
    ray.object.inside = true;
    ray.object.geometry_base = instance.geometry_base;
    ray.object.entry = entry;
    ray.object.instance_id = instance.instance_id;
    if (context_.need_normal) {
      ray.object.normals = normal_columns(instance.world_from_object);
    }
    set_frame(lane);
    lane->world_top = lane->top;
    lane->level = lane->top = lane->floor = context_.object_level;
    lane->ref = {instance.page, instance.node, 0, ExternalKind::node};
    if (image == nullptr) {
      suspend(lane, Resume::enter);
      return;
    }
    go(lane, image);
  }

  // Back to the world. False: to the node that the instance hangs on, for the ray was taken up below it.
  [[gnu::noinline]] bool leave_object(RayLane* lane) {
    RayState& ray = *lane->ray;
    traversal::leave_object(ray);
    set_frame(lane);
    lane->floor = 0;
    lane->top = lane->world_top;
    if (ray.object.level >= lane->top) {
      return true;
    }
    lane->level = lane->top = ray.object.level;
    lane->ref = {ray.object.page, ray.object.node, 0, ExternalKind::leaf};
    const std::byte* image = image_of(lane->ref.page);
    if (image == nullptr) {
      ray.left_object = true;
      suspend(lane, Resume::backtrack);
    } else {
      go(lane, image);
    }
    return false;
  }
  static void set_frame(RayLane* lane) {
    lane->frame = make_frame(lane->ray->org, lane->ray->dir);
    if constexpr (kMode == Mode::exact) {
      prepare_exact_boxes(lane->frame);
    }
  }

  // The corners' indices have come: asks for the corners.
  void fetch(RayLane* lane) {
    const Place<N>& place = lane->places[lane->level];
    const std::uint32_t count = place.node->count[lane->slot];
    const auto* indices = place.template at<std::uint16_t>(place.indices) + place.node->child[lane->slot] * 3;
    LeafBlock& leaf = lane->leaf;
    leaf.vertices = place.template at<float>(place.vertices);
    corner_indices(indices, count, leaf.index);
    for (std::uint32_t i = 0; i < count; ++i) {
      for (const auto& corners : leaf.index) {
        prefetch(leaf.vertices + corners[i]);
      }
    }
    next_->add(kFilter, lane);
  }

  // Which triangles may be hit.
  void filter_leaf(RayLane* lane) {
    const std::uint32_t count = lane->places[lane->level].node->count[lane->slot];
    counters_.triangles_tested += count;
    find_candidates(lane, count);
    now_->add(lane->candidates != 0 ? kDecide : kAdvance, lane);
  }
  [[gnu::always_inline]] static void find_candidates(RayLane* lane, std::uint32_t count) {
    const unsigned used = (1U << count) - 1;
    if constexpr (kMode == Mode::fast) {
      lane->candidates = moeller_trumbore(lane->frame, lane->leaf, lane->quotients) & used;
    } else {
      lane->candidates =
          woop_filter(lane->frame, lane->leaf, begin_of<kMode>(lane->tnear), end_of<kMode>(lane->tfar)) & used;
    }
  }

  void decide_leaf(RayLane* lane) { decide(lane, lane->candidates, TexelWait::State::none); }

  // Of the triangles of `mask`, of the first of which a mask may say already that it counts or not.
  void decide(RayLane* lane, unsigned mask, TexelWait::State texel) {
    const std::uint32_t first = lane->places[lane->level].node->child[lane->slot];
    for (; mask != 0; mask &= mask - 1, texel = TexelWait::State::none) {
      const int i = std::countr_zero(mask);
      const Corners corners = lane->leaf.triangle(i);
      Candidate hit;
      if constexpr (kMode == Mode::watertight) {
        if (!woop_decide<kQuery>(lane->frame, corners, hit)) {
          continue;
        }
      } else if constexpr (kMode == Mode::exact) {
        const bool tfar_is_hit = kQuery != Query::all && lane->ray->has_hit;
        if (!exact_decide<kQuery>(lane->frame, corners, {lane->tnear, lane->tfar, tfar_is_hit}, hit)) {
          continue;
        }
      } else {
        hit = {lane->quotients.t[i], lane->quotients.u[i], lane->quotients.v[i]};
      }
      const Offered offered =
          offer<kQuery, kMode>(context_, *lane, hit, corners, first + static_cast<std::uint32_t>(i), texel);
      if (offered == Offered::enough) {
        finish(lane);
        return;
      }
      if (offered == Offered::waits) [[unlikely]] {
        wait_for_texel(lane, i);
        return;
      }
    }
    now_->add(kAdvance, lane);
  }

  // The ray stays before triangle `i` of the leaf; those before it are settled.
  [[gnu::noinline]] void wait_for_texel(RayLane* lane, int i) {
    const Place<N>& place = lane->places[lane->level];
    TexelWait& texel = lane->ray->texel;
    texel.leaf_page = place.page;
    texel.slot = lane->slot & 7U;
    texel.triangle = static_cast<unsigned>(i) & 7U;
    texel.become(TexelWait::State::asked);
    lane->ref.node = static_cast<std::uint16_t>(place.node - place.node_at(0));
    suspend(lane, Resume::backtrack);
  }

  // Goes on in the leaf where the ray waited for a texel.
  [[gnu::noinline]] void resume_leaf(RayLane* lane) {
    const TexelWait texel = std::exchange(lane->ray->texel, {});
    const Place<N>& place = lane->places[lane->level];
    lane->slot = texel.slot;
    if ((place.node->leaf >> texel.slot & 1) == 0) {
      fail(lane);
      return;
    }
    const std::uint32_t count = place.node->count[texel.slot];
    lane->leaf.vertices = place.template at<float>(place.vertices);
    corner_indices(place.template at<std::uint16_t>(place.indices) + place.node->child[texel.slot] * 3, count,
                   lane->leaf.index);
    find_candidates(lane, count);
    const unsigned rest = lane->candidates & (~0U << texel.triangle);
    decide(lane, rest, (rest >> texel.triangle & 1) != 0 ? texel.what() : TexelWait::State::none);
  }

  KernelContext& context_;
  const std::span<RayState> rays_;
  std::size_t taken_ = 0;
  KernelCounters counters_;
  std::array<Lists, 2> lists_;
  Lists* now_ = &lists_[1];
  Lists* next_ = &lists_[0];
  std::array<RayLane, kLanes> lanes_;
};

}  // namespace raymill::traversal::RAYMILL_ISA
