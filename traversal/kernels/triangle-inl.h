// Ray-triangle tests, compiled once per ISA. The includer defines RAYMILL_ISA and includes its simd header first.
//
// watertight: Woop, Benthin, Wald 2013 (JCGT 2(1)), eq. 1-5, decided in float64. Where we differ: the paper computes
// the edge functions in float32 and falls back to float64 only where one is zero; here float32 only rejects, by more
// than its proven error, and every triangle that it cannot reject is decided in float64. So the answer is that of a
// float64 Woop test, at nearly the price of the float32 one.
//
// exact: the same float32 rejection, then exact_triangle.h.
//
// fast: Moeller, Trumbore 1997, float32.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "traversal/crossing.h"
#include "traversal/kernel.h"
#include "traversal/query.h"
#include "traversal/slab.h"

namespace raymill::traversal::RAYMILL_ISA {

using Float8 = Floats<8>;

/// What of a ray does not change while it is traced.
struct RayFrame {
  std::array<float, 3> org;
  std::array<float, 3> dir;
  std::array<float, 3> rdir;
  unsigned octant;  // bit axis: dir is negative there
  // Woop's shear: kz is the axis of dir's largest magnitude.
  int kx, ky, kz;
  float sx, sy;
};

inline RayFrame make_frame(const std::array<float, 3>& org, const std::array<float, 3>& dir) {
  RayFrame frame{};
  frame.org = org;
  frame.dir = dir;
  for (int axis = 0; axis < 3; ++axis) {
    frame.rdir[axis] = 1.0F / dir[axis];
    frame.octant |= static_cast<unsigned>(std::signbit(dir[axis])) << axis;
  }
  const float ax = std::fabs(dir[0]), ay = std::fabs(dir[1]), az = std::fabs(dir[2]);
  // Without a branch, for directions of rays cannot be foretold.
  const int y_is_larger = static_cast<int>(!(ax > ay));
  const std::array<int, 2> larger{2, y_is_larger};
  frame.kz = larger[std::max(ax, ay) > az ? 1 : 0];
  constexpr std::array<int, 4> kNext{1, 2, 0, 1};
  frame.kx = kNext[frame.kz];
  frame.ky = kNext[frame.kz + 1];
  frame.sx = dir[frame.kx] / dir[frame.kz];
  frame.sy = dir[frame.ky] / dir[frame.kz];
  return frame;
}

using Corners = std::array<std::array<float, 3>, 3>;

/// Up to eight triangles of a page: corner k of triangle i is vertices[index[k][i]]. In a page image indices follow the
/// vertices, so a float past the last one may be read. corner(k, ray): its coordinates on the axes kx, ky, kz.
struct LeafBlock {
  const float* vertices;                             // xyz after xyz
  std::array<std::array<std::int32_t, 8>, 3> index;  // of the corner's x in `vertices`

  [[nodiscard]] std::array<Float8, 3> corner(int k) const { return Float8::points(vertices, index[k]); }
  [[nodiscard]] std::array<Float8, 3> corner(int k, const RayFrame& ray) const {
    const auto point = corner(k);
    return {point[ray.kx], point[ray.ky], point[ray.kz]};
  }
  [[nodiscard]] Corners triangle(int i) const {
    Corners corners;
    for (int k = 0; k < 3; ++k) {
      const float* p = vertices + index[k][i];
      corners[k] = {p[0], p[1], p[2]};
    }
    return corners;
  }
};

/// A block of an expanded tree (expanded_tree.h). Rows are loaded whole: what comes after `count` is of other
/// triangles.
struct LeafRows {
  const float* rows;
  std::uint32_t count;

  [[nodiscard]] std::array<Float8, 3> corner(int k) const {
    const float* row = rows + 3 * static_cast<std::uint32_t>(k) * count;
    return {Float8::load(row), Float8::load(row + count), Float8::load(row + 2 * count)};
  }
  [[nodiscard]] std::array<Float8, 3> corner(int k, const RayFrame& ray) const {
    const float* row = rows + 3 * static_cast<std::uint32_t>(k) * count;
    return {Float8::load(row + static_cast<std::uint32_t>(ray.kx) * count),
            Float8::load(row + static_cast<std::uint32_t>(ray.ky) * count),
            Float8::load(row + static_cast<std::uint32_t>(ray.kz) * count)};
  }
  [[nodiscard]] Corners triangle(int i) const {
    Corners corners;
    const float* row = rows + i;
    for (auto& point : corners) {
      for (float& x : point) {
        x = *row;
        row += count;
      }
    }
    return corners;
  }
};

/// A hit before it is compared with the best so far.
struct Candidate {
  double t = 0, u = 0, v = 0;
};

// Lanes that the float32 edge functions cannot reject.
//
// With u = 2^-24, |S| <= 1 and M the largest |corner - org|: a sheared coordinate fl(fl(ax - ox) - fl(S * fl(az - oz)))
// is off by at most u (1 + 3 + 2) M (1 + O(u)) < 7 u M. An edge function Cx*By - Cy*Bx of sheared coordinates of
// magnitude at most L is then off by at most 4 * 7 u L M + 4 u L^2 (products and difference) <= 32 u L M (1 + O(u)),
// and L <= 2 M. M <= L + Z with Z the largest |z - oz|, up to u. What the coordinates' errors make together, 98 u^2
// M^2, is less than 4 u L (L + Z) where L > 31 u (L + Z), and nothing is rejected elsewhere: its magnitude, at most 2
// L^2, would have to be more than the bound. So more than 2^-18 L (L + Z) = 64 u L (L + Z) away from zero the float32
// sign is the sign in exact arithmetic, and that in float64, whose own error is 2^-29 of that. The constant added keeps
// the bound above what denormal products lose. NaN and infinity compare false: such lanes go to the decision; the bound
// is made so that it overflows before a product of the edge functions does.
//
// Nor lanes whose box ends before tnear or begins after tfar on the axis kz: with the same roundings triangle_interval
// would find that, and its other axes can only narrow it. (Mode exact gives begin_of and end_of: exact-inl.h.)
template <typename Leaf>
unsigned woop_filter(const RayFrame& ray, const Leaf& leaf, float tnear, float tfar) {
  const Float8 ox = Float8::broadcast(ray.org[ray.kx]), oy = Float8::broadcast(ray.org[ray.ky]),
               oz = Float8::broadcast(ray.org[ray.kz]);
  const Float8 sx = Float8::broadcast(ray.sx), sy = Float8::broadcast(ray.sy);
  const auto a = leaf.corner(0, ray);
  const auto b = leaf.corner(1, ray);
  const auto c = leaf.corner(2, ray);
  const Float8 az = a[2] - oz;
  const Float8 bz = b[2] - oz;
  const Float8 cz = c[2] - oz;
  const Float8 ax = a[0] - ox - sx * az;
  const Float8 bx = b[0] - ox - sx * bz;
  const Float8 cx = c[0] - ox - sx * cz;
  const Float8 ay = a[1] - oy - sy * az;
  const Float8 by = b[1] - oy - sy * bz;
  const Float8 cy = c[1] - oy - sy * cz;
  const Float8 u = cx * by - cy * bx;
  const Float8 v = ax * cy - ay * cx;
  const Float8 w = bx * ay - by * ax;
  const Float8 z = max_keep(max_keep(abs(az), abs(bz)), abs(cz));
  const Float8 l =
      max_keep(max_keep(max_keep(abs(ax), abs(ay)), max_keep(abs(bx), abs(by))), max_keep(abs(cx), abs(cy)));
  const Float8 bound = l * (l + z) * Float8::broadcast(0x1p-18F) + Float8::broadcast(0x1p-120F);
  const Float8 low = min_keep(min_keep(u, v), w);
  const Float8 high = max_keep(max_keep(u, v), w);
  const Float8 minus_bound = Float8::broadcast(0.0F) - bound;
  const Float8 nearest = min_keep(min_keep(az, bz), cz), furthest = max_keep(max_keep(az, bz), cz);
  const Float8 rdir = Float8::broadcast(ray.rdir[ray.kz]), dir = Float8::broadcast(ray.dir[ray.kz]);
  const Float8 entry = select_by_sign(dir, nearest, furthest) * rdir;
  Float8 exit = select_by_sign(dir, furthest, nearest) * rdir;
  exit = exit + abs(exit) * Float8::broadcast(kExitPad);
  const unsigned rejected = (less(low, minus_bound) & less(bound, high)) | less(Float8::broadcast(tfar), entry) |
                            less(exit, Float8::broadcast(tnear));
  return ~rejected & 0xFFU;
}

// The decision. Corners minus org are exact or rounded once in float64; an edge shared by two triangles gives both the
// same value with opposite sign, and a zero counts as inside for both, so nothing passes between them.
// Where crossings are asked for, one of them has the zero (crossing.h).
template <Query kQuery>
bool woop_decide(const RayFrame& ray, const Corners& corners, Candidate& hit) {
  const double dz = ray.dir[ray.kz];
  const double sx = ray.dir[ray.kx] / dz, sy = ray.dir[ray.ky] / dz, sz = 1.0 / dz;
  std::array<double, 3> x, y, z;
  for (int k = 0; k < 3; ++k) {
    z[k] = double(corners[k][ray.kz]) - ray.org[ray.kz];
    x[k] = double(corners[k][ray.kx]) - ray.org[ray.kx] - sx * z[k];
    y[k] = double(corners[k][ray.ky]) - ray.org[ray.ky] - sy * z[k];
  }
  double u = x[2] * y[1] - y[2] * x[1];
  double v = x[0] * y[2] - y[0] * x[2];
  double w = x[1] * y[0] - y[1] * x[0];
  if ((u < 0 || v < 0 || w < 0) && (u > 0 || v > 0 || w > 0)) {
    return false;
  }
  if constexpr (kQuery == Query::all) {
    if (u == 0 || v == 0 || w == 0) [[unlikely]] {
      EdgeFunctions edges{u, v, w};
      if (!owns_crossing({x, y}, edges)) {
        return false;
      }
      u = edges.u;
      v = edges.v;
      w = edges.w;
    }
  }
  const double det = u + v + w;
  if (det == 0) {
    return false;  // the ray lies in the triangle's plane
  }
  hit.t = (u * (sz * z[0]) + v * (sz * z[1]) + w * (sz * z[2])) / det;
  hit.u = v / det;
  hit.v = w / det;
  return true;
}

struct Quotients {
  std::array<float, 8> t, u, v;
};

/// The triangles whose barycentrics are inside, and the quotients of all.
template <typename Leaf>
unsigned moeller_trumbore(const RayFrame& ray, const Leaf& leaf, Quotients& out) {
  std::array<Float8, 3> v0, e1, e2, dir, s, p, q;
  v0 = leaf.corner(0);
  e1 = leaf.corner(1);
  e2 = leaf.corner(2);
  for (int axis = 0; axis < 3; ++axis) {
    e1[axis] = e1[axis] - v0[axis];
    e2[axis] = e2[axis] - v0[axis];
    dir[axis] = Float8::broadcast(ray.dir[axis]);
    s[axis] = Float8::broadcast(ray.org[axis]) - v0[axis];
  }
  const auto cross = [](const std::array<Float8, 3>& a, const std::array<Float8, 3>& b) {
    return std::array<Float8, 3>{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  };
  const auto dot = [](const std::array<Float8, 3>& a, const std::array<Float8, 3>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  };
  p = cross(dir, e2);
  q = cross(s, e1);
  const Float8 inverse = Float8::broadcast(1.0F) / dot(e1, p);
  const Float8 u = dot(s, p) * inverse;
  const Float8 v = dot(dir, q) * inverse;
  const Float8 t = dot(e2, q) * inverse;
  const Float8 zero = Float8::broadcast(0.0F);
  t.store(out.t.data());
  u.store(out.u.data());
  v.store(out.v.data());
  // A zero determinant gives NaN or infinity, which no comparison lets through.
  return less_equal(zero, u) & less_equal(zero, v) & less_equal(u + v, Float8::broadcast(1.0F));
}

// Inside by the signs; the quotients may stick out by a rounding.
inline void set_barycentrics(Hit& out, const Candidate& hit) {
  const auto clamp = [](float x) { return x < 0.0F ? 0.0F : x > 1.0F ? 1.0F : x; };
  out.u = clamp(static_cast<float>(hit.u));
  const float v = clamp(static_cast<float>(hit.v));
  out.v = out.u + v > 1.0F ? 1.0F - out.u : v;
}

inline std::array<float, 3> normal_of(const Corners& corners) {
  std::array<double, 3> e1, e2;
  for (int axis = 0; axis < 3; ++axis) {
    e1[axis] = double(corners[1][axis]) - corners[0][axis];
    e2[axis] = double(corners[2][axis]) - corners[0][axis];
  }
  const std::array<double, 3> n{e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2],
                                e1[0] * e2[1] - e1[1] * e2[0]};
  const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
  std::array<float, 3> normal{};
  for (int axis = 0; axis < 3; ++axis) {
    normal[axis] = length > 0 ? static_cast<float>(n[axis] / length) : 0.0F;
  }
  return normal;
}

inline Crossing crossing_of(std::uint32_t number, float t, const Candidate& hit, const PrimitiveIds& ids,
                            const std::array<float, 3>& normal) {
  Crossing crossing{number, {}};
  crossing.hit.t = t;
  set_barycentrics(crossing.hit, hit);
  crossing.hit.geometry_id = ids.geometry_id;
  crossing.hit.primitive_id = ids.primitive_id;
  crossing.hit.normal = normal;
  return crossing;
}

struct Interval {
  float entry, exit;
};

// A box by the formula of the nodes (slab.h); min_keep and max_keep for one lane, without a branch.
[[gnu::always_inline]] inline Interval box_interval(const RayFrame& ray, const std::array<float, 3>& lower,
                                                    const std::array<float, 3>& upper) {
  Interval interval{-INFINITY, INFINITY};
  for (int axis = 0; axis < 3; ++axis) {
    const std::array<float, 2> ends{lower[axis], upper[axis]};
    const unsigned negative = ray.octant >> axis & 1;
    const float near = (ends[negative] - ray.org[axis]) * ray.rdir[axis];
    const float far = (ends[negative ^ 1] - ray.org[axis]) * ray.rdir[axis];
    interval.entry = near > interval.entry ? near : interval.entry;
    interval.exit = far < interval.exit ? far : interval.exit;
  }
  interval.exit = interval.exit + std::fabs(interval.exit) * kExitPad;
  return interval;
}

// The triangle's own box.
inline Interval triangle_interval(const RayFrame& ray, const Corners& corners) {
  std::array<float, 3> lower, upper;
  for (int axis = 0; axis < 3; ++axis) {
    const float a = corners[0][axis], b = corners[1][axis], c = corners[2][axis];
    const float low_ab = a < b ? a : b, high_ab = a > b ? a : b;
    lower[axis] = low_ab < c ? low_ab : c;
    upper[axis] = high_ab > c ? high_ab : c;
  }
  return box_interval(ray, lower, upper);
}

/// The t that a hit counts with: clamped into the triangle's own box, so that no order of tests could tell (slab.h);
/// in mode exact it has been placed. False: it is none, or lies outside [tnear, tfar].
template <Mode kMode>
bool place_hit(const RayFrame& ray, const Corners& corners, const Candidate& hit, float tnear, float tfar, float& t) {
  t = static_cast<float>(hit.t);
  if constexpr (kMode == Mode::exact) {
    return true;
  } else {
    const Interval box = triangle_interval(ray, corners);
    if (!(box.entry <= box.exit)) {
      return false;
    }
    t = t < box.entry ? box.entry : t;
    t = t > box.exit ? box.exit : t;
    return t >= tnear && t <= tfar;
  }
}

}  // namespace raymill::traversal::RAYMILL_ISA
