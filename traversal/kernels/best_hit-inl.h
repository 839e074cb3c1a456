// What becomes of a hit: it is held against the filter, counted, listed, or against the best so far. Compiled once per
// ISA.
#pragma once

#include <limits>

#include "traversal/kernels/instance-inl.h"
#include "traversal/kernels/lane-inl.h"

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

/// Takes the hit if it lies in the interval and before the best so far: by t, then geometry id, then primitive id.
/// True: no other hit is wanted.
template <Query kQuery, Mode kMode, int N>
bool offer(KernelContext& context, Lane<N>& lane, const Candidate& hit, const Corners& corners,
           std::uint32_t triangle) {
  float t = 0;
  if (!place_hit<kMode>(lane.frame, corners, hit, lane.tnear, lane.tfar, t)) {
    return false;
  }
  RayState& ray = *lane.ray;
  const std::byte* image = lane.places[lane.level].image;
  std::uint32_t base = 0;
  if (lane.floor != 0) {
    base = ray.object.geometry_base;
    t = t < ray.object.entry ? ray.object.entry : t;
    if (!(t <= lane.tfar) || t == std::numeric_limits<float>::infinity()) {
      return false;
    }
  }
  if (context.filter != nullptr && context.filter->drops(ray.skipped, ray.mask, ids_of(image, triangle, base))) {
    return false;
  }
  if constexpr (kQuery == Query::any) {
    ray.hit = {};
    ray.hit.t = 0;
    ray.has_hit = true;
    return true;
  } else if constexpr (kQuery == Query::all) {
    ray.has_hit = true;
    ++ray.hit.count;
    if (context.crossings != nullptr) {
      Crossing crossing = crossing_of(ray.number, t, hit, ids_of(image, triangle, base),
                                      context.need_normal ? normal(lane, corners) : std::array<float, 3>{});
      crossing.hit.instance_id = instance_id(lane);
      context.crossings->add(crossing);
    }
    return false;
  } else {
    if (t == lane.tfar && ray.has_hit && !wins_tie<kMode>(lane, corners, ids_of(image, triangle, base))) {
      return false;
    }
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
    return false;
  }
}

}  // namespace raymill::traversal::RAYMILL_ISA
