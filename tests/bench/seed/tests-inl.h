// What all algorithms share: the ray at work, its box tests and its triangle test. Compiled once per ISA; the includer
// defines RAYMILL_ISA and includes its simd header first.
//
// Hits do not depend on the order of visits: boxes follow the monotone rule of traversal/slab.h, and a triangle's t is
// kept within the triangle's own box, so no box that holds the nearest hit is ever culled.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>

#include "tests/bench/seed/kernels.h"
#include "traversal/kernels/triangle-inl.h"
#include "traversal/slab.h"

namespace raymill::bench::RAYMILL_ISA {

namespace isa = traversal::RAYMILL_ISA;

/// A ray at work.
struct RayWork {
  explicit RayWork(const Ray& ray)
      : frame(isa::make_frame(ray.org, ray.dir)),
        tnear(ray.tnear),
        tfar(std::min(ray.tfar, std::numeric_limits<float>::max())) {
    for (unsigned axis = 0; axis < 3; ++axis) {
      near_row[axis] = 2 * axis + (frame.octant >> axis & 1);
    }
  }
  [[nodiscard]] SeedHit hit() const {
    return {triangle == kNoReference ? std::numeric_limits<float>::infinity() : tfar, u, v, triangle};
  }

  isa::RayFrame frame;
  std::array<unsigned, 3> near_row;  // of a node's planes; the far row is the other one of its axis
  float tnear;
  float tfar;  // of the nearest hit so far
  float u = 0, v = 0;
  std::uint32_t triangle = kNoReference;
};

template <int Lanes>
isa::Floats<Lanes> load(const float* from) {
  isa::Floats<Lanes> lanes;
  static_assert(sizeof lanes == Lanes * sizeof(float));
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

// Children `first` to `first` + Lanes of a node: the mask of those that the ray meets, and where it enters them.
template <int Lanes, unsigned N>
[[gnu::always_inline]] inline unsigned test_lanes(const Node<N>& node, const RayWork& ray, unsigned first,
                                                  std::array<float, N>& entries) {
  using Floats = isa::Floats<Lanes>;
  Floats entry = Floats::broadcast(ray.tnear);
  Floats exit = Floats::broadcast(std::numeric_limits<float>::infinity());
  for (unsigned axis = 0; axis < 3; ++axis) {
    const Floats org = Floats::broadcast(ray.frame.org[axis]), rdir = Floats::broadcast(ray.frame.rdir[axis]);
    const unsigned near = ray.near_row[axis];
    entry = max_keep((load<Lanes>(&node.planes[near][first]) - org) * rdir, entry);
    exit = min_keep((load<Lanes>(&node.planes[near ^ 1][first]) - org) * rdir, exit);
  }
  exit = exit + abs(exit) * Floats::broadcast(traversal::kExitPad);
  entry.store(&entries[first]);
  return less_equal(entry, min_keep(exit, Floats::broadcast(ray.tfar)));
}

struct BoxHit {
  float entry;
  bool is_hit;
};

/// The same test for one box; `planes(row)` gives its planes.
template <typename Planes>
[[gnu::always_inline]] inline BoxHit test_box(const RayWork& ray, Planes&& planes) {
  float entry = ray.tnear, exit = std::numeric_limits<float>::infinity();
  for (unsigned axis = 0; axis < 3; ++axis) {
    const unsigned row = ray.near_row[axis];
    const float near = (planes(row) - ray.frame.org[axis]) * ray.frame.rdir[axis];
    const float far = (planes(row ^ 1) - ray.frame.org[axis]) * ray.frame.rdir[axis];
    entry = near > entry ? near : entry;
    exit = far < exit ? far : exit;
  }
  exit = exit + std::fabs(exit) * traversal::kExitPad;
  return {entry, entry <= (exit < ray.tfar ? exit : ray.tfar)};
}

template <unsigned N>
[[gnu::always_inline]] inline unsigned test_boxes(const Node<N>& node, const RayWork& ray,
                                                  std::array<float, N>& entries) {
  if constexpr (N == 2) {
    unsigned mask = 0;
    for (unsigned slot = 0; slot < 2; ++slot) {
      const BoxHit box = test_box(ray, [&](unsigned row) { return node.planes[row][slot]; });
      entries[slot] = box.entry;
      mask |= static_cast<unsigned>(box.is_hit) << slot;
    }
    return mask;
  } else if constexpr (N == 16 && !requires { sizeof(isa::Floats<N>); }) {
    return test_lanes<8, N>(node, ray, 0, entries) | test_lanes<8, N>(node, ray, 8, entries) << 8;
  } else {
    return test_lanes<N, N>(node, ray, 0, entries);
  }
}

// Takes the hit if it lies in the interval and before the best so far: by t, then by the triangle's index.
inline void offer(RayWork& ray, const isa::Corners& corners, std::uint32_t triangle, float t, float u, float v) {
  const isa::Interval box = isa::triangle_interval(ray.frame, corners);
  if (!(box.entry <= box.exit)) {
    return;
  }
  t = t < box.entry ? box.entry : t;
  t = t > box.exit ? box.exit : t;
  if (t >= ray.tnear && (t < ray.tfar || (t == ray.tfar && triangle < ray.triangle))) {
    ray.tfar = t;
    ray.u = u;
    ray.v = v;
    ray.triangle = triangle;
  }
}

using Vector = std::array<float, 3>;
inline Vector minus(const Vector& a, const Vector& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
inline Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline float dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// Moeller, Trumbore 1997, one triangle after the other. Not inlined: the same instructions for all algorithms.
[[gnu::noinline]] inline void test_triangles(const Trees& trees, RayWork& ray, std::uint32_t first,
                                             std::uint32_t count) {
  for (std::uint32_t i = first; i < first + count; ++i) {
    const isa::Corners& corners = trees.triangles[i];
    const Vector e1 = minus(corners[1], corners[0]), e2 = minus(corners[2], corners[0]);
    const Vector s = minus(ray.frame.org, corners[0]);
    const Vector p = cross(ray.frame.dir, e2), q = cross(s, e1);
    // A zero determinant gives NaN or infinity, which no comparison lets through.
    const float inverse = 1.0F / dot(e1, p);
    const float u = dot(s, p) * inverse, v = dot(ray.frame.dir, q) * inverse;
    if (u >= 0 && v >= 0 && u + v <= 1) {
      offer(ray, corners, i, dot(e2, q) * inverse, u, v);
    }
  }
}

/// Counts, or does nothing, so that counting costs the timed form nothing.
template <bool kCounts>
struct Tally {
  void node(unsigned children_hit) {
    if constexpr (kCounts) {
      ++sums.nodes;
      ++sums.children_hit[children_hit];
    }
  }
  void triangles(std::uint32_t count) {
    if constexpr (kCounts) {
      sums.triangles += count;
    }
  }
  void entries(std::uint64_t count) {
    if constexpr (kCounts) {
      sums.most_entries = std::max(sums.most_entries, count);
    }
  }
  Counters sums;
};

template <bool kCounts>
[[gnu::always_inline]] inline void test_leaf(const Trees& trees, std::uint32_t reference, RayWork& ray,
                                             Tally<kCounts>& tally) {
  tally.triangles(leaf_count(reference));
  test_triangles(trees, ray, leaf_first(reference), leaf_count(reference));
}

}  // namespace raymill::bench::RAYMILL_ISA
