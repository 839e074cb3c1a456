// Subtrees that a ray does not enter, because a tolerance was given and a proxy stands for them; compiled once per ISA.
//
// A subtree qualifies where the ray's way through its box, from entry to exit, is at most twice the tolerance. Whether
// it is hit is decided by its proxy's opacity and a hash; a hit lies at the middle of that way, so that a hit which the
// ray truly has inside is at most the tolerance away from it. Nothing that decides depends on what is resident, on the
// best hit so far or on other rays: the box, the proxy and the ray's own org, dir and tnear alone. So the answers to a
// ray are a set that is fixed, of triangles' hits and of proxies', and the least of it is found in every order:
//   entry <= t      as for triangles (slab.h): the box and those above it are visited as long as entry <= tfar
//   tie at t        by the ids, which a proxy has of its largest triangle
// A ray that begins inside a box, or before whose tnear the box begins, enters it: it would meet the surface that it
// leaves. So it does where hits are held against masks that parts of the subtree may pass and others not.
// In mode exact nothing qualifies: its answers are exact or none.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>

#include "storage/pages/page_image.h"
#include "traversal/kernels/best_hit-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

enum class ProxyAnswer : std::uint8_t {
  enter,  ///< no answer: the subtree is entered
  go_on,  ///< passed, or hit and taken as the best so far
  done,   ///< no other hit is wanted
};

// The mixer of Steele, Lea, Flood 2014 ("SplitMix64").
inline std::uint64_t mixed(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15U;
  x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9U;
  x = (x ^ x >> 27) * 0x94D049BB133111EBU;
  return x ^ x >> 31;
}
inline std::uint64_t mixed(std::uint64_t hash, const std::array<float, 3>& values) {
  for (const float value : values) {
    hash = mixed(hash ^ std::bit_cast<std::uint32_t>(value));
  }
  return hash;
}

/// A number of [0, 1) that the ray in the world, the box and the instance decide.
inline double draw(const RayState& ray, const std::array<float, 3>& lower, const std::array<float, 3>& upper,
                   std::uint32_t instance_id) {
  const std::uint64_t of_ray = mixed(mixed(instance_id, ray.object.inside ? ray.object.world_org : ray.org),
                                     ray.object.inside ? ray.object.world_dir : ray.dir);
  return static_cast<double>(mixed(mixed(of_ray, lower), upper) >> 11) * 0x1p-53;
}

/// Half of the way through a box that qualifies, in lengths of dir.
inline double allowed_half(const Footprint& footprint, const RayState& ray, float entry) {
  double squares = 0;
  for (const float x : ray.object.inside ? ray.object.world_dir : ray.dir) {
    squares += double(x) * x;
  }
  return std::max(footprint.length / std::sqrt(squares), footprint.angle * entry);
}

template <int N>
void decode_box(const Node<N>& node, unsigned slot, std::array<float, 3>& lower, std::array<float, 3>& upper) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float scale = std::bit_cast<float>(static_cast<std::uint32_t>(node.exponent[axis] + 127) << 23);
    lower[axis] = storage::decode_plane(node.base[axis], scale, node.lower[axis][slot]);
    upper[axis] = storage::decode_plane(node.base[axis], scale, node.upper[axis][slot]);
  }
}

/// Takes a proxy's hit as offer() does a triangle's.
template <Query kQuery, int N>
ProxyAnswer offer_proxy(const KernelContext& context, Lane<N>& lane, const storage::Proxy& proxy, float t,
                        const PrimitiveIds& ids) {
  RayState& ray = *lane.ray;
  if constexpr (kQuery == Query::any) {
    ray.hit = {};
    ray.hit.t = 0;
    ray.has_hit = true;
    return ProxyAnswer::done;
  } else {
    if (t == lane.tfar && ray.has_hit) {
      identify(lane);
      if (!(ids < PrimitiveIds{ray.hit.geometry_id, ray.hit.primitive_id})) {
        return ProxyAnswer::go_on;
      }
    }
    lane.tfar = t;
    lane.hit_image = nullptr;
    ray.has_hit = true;
    ray.hit.t = t;
    ray.hit.u = ray.hit.v = kProxyBarycentric;
    ray.hit.geometry_id = ids.geometry_id;
    ray.hit.primitive_id = ids.primitive_id;
    ray.hit.instance_id = instance_id(lane);
    if (context.need_normal) {
      std::array<float, 3> normal{};
      double squares = 0;
      for (const std::int8_t x : proxy.normal) {
        squares += double(x) * x;
      }
      for (std::size_t axis = 0; axis < 3 && squares > 0; ++axis) {
        normal[axis] = static_cast<float>(proxy.normal[axis] / std::sqrt(squares));
      }
      ray.hit.normal = lane.floor != 0 ? world_normal(ray.object.normals, normal) : normal;
    }
    return ProxyAnswer::go_on;
  }
}

/// What the proxy of the child in the lane's slot of the node at `place` answers.
template <Query kQuery, Mode kMode, int N>
ProxyAnswer ask_proxy(const KernelContext& context, Lane<N>& lane, const Place<N>& place) {
  if constexpr (kMode == Mode::exact || kQuery == Query::all) {
    return ProxyAnswer::enter;
  } else {
    RayState& ray = *lane.ray;
    std::array<float, 3> lower, upper;
    decode_box<N>(*place.node, lane.slot, lower, upper);
    const Interval box = box_interval(lane.frame, lower, upper);
    // The middle is rounded, so the rest of the way is given the pad's room.
    const double exit = std::max(box.entry, box.exit);
    const double half = (exit - box.entry) / 2 + std::fabs(exit) * kExitPad;
    if (!(box.entry > lane.tnear) || !(half <= allowed_half(*context.footprint, ray, box.entry))) {
      return ProxyAnswer::enter;
    }
    const storage::Proxy& proxy = PageView(place.image).proxies()[place.node->child[lane.slot]];
    const std::uint32_t base = lane.floor != 0 ? ray.object.geometry_base : 0;
    const PrimitiveIds ids{base + proxy.geometry_id, proxy.primitive_id};
    if (context.filter != nullptr && (proxy.several != 0 || context.filter->drops(ray.skipped, ray.mask, ids))) {
      return ProxyAnswer::enter;
    }
    const float entry = lane.floor != 0 ? std::max(box.entry, ray.object.entry) : box.entry;
    const float t = std::max(entry, static_cast<float>((box.entry + exit) / 2));
    const bool hit = draw(ray, lower, upper, instance_id(lane)) <
                     storage::opacity(proxy, storage::face_areas(lower, upper), lane.frame.dir);
    if (!hit || !(t <= lane.tfar) || t == std::numeric_limits<float>::infinity()) {
      return ProxyAnswer::go_on;
    }
    return offer_proxy<kQuery>(context, lane, proxy, t, ids);
  }
}

}  // namespace raymill::traversal::RAYMILL_ISA
