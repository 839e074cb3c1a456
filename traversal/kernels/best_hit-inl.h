// What becomes of a hit: it is held against the filter, counted, listed, or against the best so far. Compiled once per
// ISA.
#pragma once

#include <limits>

#include "traversal/kernels/instance-inl.h"
#include "traversal/kernels/lane-inl.h"
#include "traversal/mask_test.h"

namespace raymill::traversal::RAYMILL_ISA {

using storage::PageView;

inline PrimitiveIds ids_of(const std::byte* image, std::uint32_t triangle, std::uint32_t base) {
  const PageView view(image);
  return {base + view.geometry_id(triangle), view.primitive_ids()[triangle]};
}

/// The best hit's ids are looked up when they are needed, for they are far from what the tests read.
template <int N>
void identify(Lane<N>& lane) {
  if (lane.hit_image != nullptr) {
    const PrimitiveIds ids = ids_of(lane.hit_image, lane.hit_triangle, lane.hit_base);
    lane.ray->hit.geometry_id = ids.geometry_id;
    lane.ray->hit.primitive_id = ids.primitive_id;
    lane.hit_image = nullptr;
  }
}

template <int N>
std::uint32_t instance_id(const Lane<N>& lane) {
  return lane.floor != 0 ? lane.ray->object.instance_id : kNoId;
}

template <int N>
std::array<float, 3> normal(const Lane<N>& lane, const Corners& corners) {
  return lane.floor != 0 ? world_normal(lane.ray->object.normals, normal_of(corners)) : normal_of(corners);
}

// Against the best so far, at equal t, by the ids. In mode exact by t before it was rounded first: within an object,
// for each has a ray of its own; among objects by the instance's id, triangles of the world last.
template <Mode kMode, int N>
bool wins_tie(Lane<N>& lane, const Corners& corners, const PrimitiveIds& ids) {
  Hit& best = lane.ray->hit;
  if constexpr (kMode == Mode::exact) {
    if (instance_id(lane) != best.instance_id) {
      return instance_id(lane) < best.instance_id;
    }
    const int order = exact_order({lane.frame.org, lane.frame.dir}, corners, lane.ray->corners);
    if (order != 0) {
      return order < 0;
    }
  }
  identify(lane);
  return ids < PrimitiveIds{best.geometry_id, best.primitive_id};
}

enum class Offered : std::uint8_t {
  goes_on,
  enough,  ///< no other hit is wanted
  waits,   ///< the texel that decides is not there: the ray's `texel` and the lane's `ref` say which
};

// Whether the triangle counts where the ray meets it. The page of its texel may not be there.
template <int N>
[[gnu::noinline]] Offered pass_mask(KernelContext& context, Lane<N>& lane, const Candidate& hit, const Corners& corners,
                                    std::uint32_t triangle, bool& passes) {
  const std::byte* image = lane.places[lane.level].image;
  passes = true;
  if (!storage::MaskSectionView::has_masks(image)) {
    return Offered::goes_on;
  }
  const MaskAnswer answer =
      test_mask(image, triangle, {lane.frame.org, lane.frame.dir, corners, hit.u, hit.v}, context.page_bytes);
  ++context.counters.masks_tested;
  if (answer.what != MaskAnswer::What::look_up) {
    passes = answer.what == MaskAnswer::What::counts;
    return Offered::goes_on;
  }
  ++context.counters.texels_read;
  const std::byte* texels = context.images[answer.page].load(std::memory_order_acquire);
  if (texels == nullptr) {
    lane.ray->texel.texel = answer.texel;
    lane.ray->texel.least = answer.least;
    lane.ray->texel.bits = answer.bits;
    lane.ref.page = answer.page;
    return Offered::waits;
  }
  if (context.touched[answer.page].load(std::memory_order_relaxed) == 0) {
    context.touched[answer.page].store(1, std::memory_order_relaxed);
  }
  context.corrupt = !read_texel(texels, answer.texel, answer.bits, answer.least, passes) || context.corrupt;
  return Offered::goes_on;
}

/// A ray before a masked triangle has come to the page of its texel. False: that is not there, or has no such texel.
[[gnu::noinline]] inline bool answer_texel(KernelContext& context, RayState& ray) {
  const std::byte* image = context.images[ray.page].load(std::memory_order_acquire);
  bool counts = false;
  if (image == nullptr) {
    return false;
  }
  context.touched[ray.page].store(1, std::memory_order_relaxed);
  ++context.counters.pages_entered;
  if (!read_texel(image, ray.texel.texel, ray.texel.bits, ray.texel.least, counts)) {
    context.corrupt = true;
    ray.done = true;
    return false;
  }
  ray.texel.become(counts ? TexelWait::State::counts : TexelWait::State::cut);
  ray.page = ray.texel.leaf_page;
  return true;
}

/// Takes the hit if it lies in the interval and before the best so far: by t, then geometry id, then primitive id.
/// `texel`: what a mask says of it, where that is known.
template <Query kQuery, Mode kMode, int N>
Offered offer(KernelContext& context, Lane<N>& lane, const Candidate& hit, const Corners& corners,
              std::uint32_t triangle, TexelWait::State texel) {
  float t = 0;
  if (!place_hit<kMode>(lane.frame, corners, hit, lane.tnear, lane.tfar, t)) {
    return Offered::goes_on;
  }
  RayState& ray = *lane.ray;
  const std::byte* image = lane.places[lane.level].image;
  std::uint32_t base = 0;
  if (lane.floor != 0) {
    base = ray.object.geometry_base;
    t = t < ray.object.entry ? ray.object.entry : t;
    if (!(t <= lane.tfar) || t == std::numeric_limits<float>::infinity()) {
      return Offered::goes_on;
    }
  }
  if (context.filter != nullptr && context.filter->drops(ray.skipped, ray.mask, ids_of(image, triangle, base))) {
    return Offered::goes_on;
  }
  if constexpr (kQuery == Query::closest) {
    if (t == lane.tfar && ray.has_hit && !wins_tie<kMode>(lane, corners, ids_of(image, triangle, base))) {
      return Offered::goes_on;
    }
  }
  if (context.masks && texel != TexelWait::State::counts) {
    bool passes = false;
    const Offered offered =
        texel == TexelWait::State::cut ? Offered::goes_on : pass_mask(context, lane, hit, corners, triangle, passes);
    if (!passes || offered != Offered::goes_on) {
      return offered;
    }
  }
  if constexpr (kQuery == Query::any) {
    ray.hit = {};
    ray.hit.t = 0;
    ray.has_hit = true;
    return Offered::enough;
  } else if constexpr (kQuery == Query::all) {
    ray.has_hit = true;
    ++ray.hit.count;
    if (context.crossings != nullptr) {
      Crossing crossing = crossing_of(ray.number, t, hit, ids_of(image, triangle, base),
                                      context.need_normal ? normal(lane, corners) : std::array<float, 3>{});
      crossing.hit.instance_id = instance_id(lane);
      context.crossings->add(crossing);
    }
    return Offered::goes_on;
  } else {
    lane.tfar = t;
    lane.hit_image = image;
    lane.hit_triangle = triangle;
    lane.hit_base = base;
    ray.has_hit = true;
    ray.hit.t = t;
    ray.hit.instance_id = instance_id(lane);
    set_barycentrics(ray.hit, hit);
    if (context.need_normal) {
      ray.hit.normal = normal(lane, corners);
    }
    if constexpr (kMode == Mode::exact) {
      ray.corners = corners;
    }
    return Offered::goes_on;
  }
}

}  // namespace raymill::traversal::RAYMILL_ISA
