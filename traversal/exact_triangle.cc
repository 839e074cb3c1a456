#include "traversal/exact_triangle.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

#include "traversal/expansion.h"

namespace raymill::traversal {
namespace {

constexpr float kMostFloat = std::numeric_limits<float>::max();
constexpr double kRounding = 0x1p-53;

// ---------------------------------------------------------------------------------------------------------------
// float64, with a bound of its error

// Woop's test in float64. A float32 difference is rounded once (e = 2^-53), so with |S| <= 1, L the largest sheared
// |x| or |y| and Z the largest |z| the proof at woop_filter holds with e for u: an edge function of a magnitude of more
// than 2^-47 L (L + Z), the edge error, has the sign that it has in exact arithmetic, and where there is one, all three
// are off by less than 0.56 of that. No product underflows: S and z, where not zero, are at least 2^-277 and 2^-149,
// so coordinates are multiples of 2^-478; none overflows, for they are below 2^131.
struct RoughTest {
  double u, v, w, det;
  double edge_error;
  double z, z1, z2;  // along the axis of dir's largest magnitude: the first corner, and from it to the others
  double dz;
};

struct Axes {
  unsigned x, y, z;  // z: of dir's largest magnitude
};

Axes axes_of(const std::array<float, 3>& dir) {
  const float ax = std::fabs(dir[0]), ay = std::fabs(dir[1]), az = std::fabs(dir[2]);
  const unsigned z = ax > ay ? (ax > az ? 0 : 2) : (ay > az ? 1 : 2);
  const unsigned x = z == 2 ? 0 : z + 1;
  return {x, x == 2 ? 0 : x + 1, z};
}

RoughTest test_roughly(const ExactRay& ray, const ExactCorners& corners) {
  const std::array<float, 3>& dir = ray.dir;
  const auto [kx, ky, kz] = axes_of(dir);
  RoughTest rough{};
  rough.dz = dir[kz];
  const double sx = dir[kx] / rough.dz, sy = dir[ky] / rough.dz;
  std::array<double, 3> x, y, z;
  double most_xy = 0, most_z = 0;
  for (unsigned k = 0; k < 3; ++k) {
    z[k] = double(corners[k][kz]) - ray.org[kz];
    x[k] = double(corners[k][kx]) - ray.org[kx] - sx * z[k];
    y[k] = double(corners[k][ky]) - ray.org[ky] - sy * z[k];
    most_xy = std::max({most_xy, std::fabs(x[k]), std::fabs(y[k])});
    most_z = std::max(most_z, std::fabs(z[k]));
  }
  rough.u = x[2] * y[1] - y[2] * x[1];
  rough.v = x[0] * y[2] - y[0] * x[2];
  rough.w = x[1] * y[0] - y[1] * x[0];
  rough.det = rough.u + rough.v + rough.w;
  rough.edge_error = 0x1p-47 * most_xy * (most_xy + most_z);
  rough.z = z[0];
  rough.z1 = double(corners[1][kz]) - corners[0][kz];
  rough.z2 = double(corners[2][kz]) - corners[0][kz];
  return rough;
}

enum class Side : std::uint8_t { outside, inside, unsure };

// Inside is said only where the edge error is at most 2^-24 det, so v / det and w / det are off by less than 2^-22.
Side side_of(const RoughTest& rough) {
  const double low = std::min({rough.u, rough.v, rough.w}), high = std::max({rough.u, rough.v, rough.w});
  if (low < -rough.edge_error && high > rough.edge_error) {
    return Side::outside;
  }
  const double det = std::fabs(rough.det);
  const bool certain = low > rough.edge_error || high < -rough.edge_error;
  // A determinant so small could lose digits of v * z1 to underflow.
  return certain && det > 0x1p24 * rough.edge_error && det > 0x1p-600 ? Side::inside : Side::unsure;
}

// t = (z + (v z1 + w z2) / det) / dz, for a ray that is inside. With R = |z1| + |z2|, D = |det| and each edge function
// off by F = 0.56 edge errors: v z1 + w z2 is off by F R + 3e D R, det by 3 F + 2e D, so the quotient, at most R, by
// R (4 F / D + 6e); the sum and the division add e (3 |z| + 2 R). The constants below are larger, so that they cover
// the roundings of the bound itself and of t - error and t + error.
struct RoughT {
  double low, high;
};

RoughT rough_t(const RoughTest& rough) {
  const double reach = std::fabs(rough.z1) + std::fabs(rough.z2);
  const double t = (rough.z + (rough.v * rough.z1 + rough.w * rough.z2) / rough.det) / rough.dz;
  const double error =
      (reach * (4 * rough.edge_error / std::fabs(rough.det) + 16 * kRounding) + 8 * kRounding * std::fabs(rough.z)) /
      std::fabs(rough.dz);
  return {t - error, t + error};
}

enum class Verdict : std::uint8_t { miss, hit, unsure };

Verdict place_roughly(const RoughTest& rough, const ExactInterval& interval, float& t) {
  const RoughT range = rough_t(rough);
  // To nearest, ties to even, and monotone: t rounds between the two.
  const auto low = static_cast<float>(range.low), high = static_cast<float>(range.high);
  if (high < interval.tnear || low > interval.tfar) {
    return Verdict::miss;
  }
  if (low != high || (low == interval.tnear && range.low < interval.tnear) ||
      (low == interval.tfar && !interval.tfar_is_hit && range.high > interval.tfar)) {
    return Verdict::unsure;
  }
  t = low + 0.0F;
  return Verdict::hit;
}

// ---------------------------------------------------------------------------------------------------------------
// Expansions
//
// Range: float32 values are multiples of 2^-149 below 2^128. Their differences are multiples of 2^-149 below 2^129, an
// edge function, the determinant and t's numerator (three factors, six terms) multiples of 2^-447 below 2^390; times a
// float32 or the middle between two, multiples of 2^-597 below 2^519; numerator times determinant, multiples of 2^-894
// below 2^781. float64 has multiples of 2^-1074 below 2^1024: nothing underflows or overflows.

using ExactVector = std::array<Expansion<2>, 3>;
using ExactProduct = Expansion<96>;     // of three vectors, one of them float32
using ExactNumerator = Expansion<192>;  // of three vectors

constexpr int kFewParts = (390 + 447) / 52 + 1;  // of a compressed product of three
using FewParts = Expansion<kFewParts>;

ExactVector from_to(const std::array<float, 3>& from, const std::array<float, 3>& to) {
  return {exact_difference(to[0], from[0]), exact_difference(to[1], from[1]), exact_difference(to[2], from[2])};
}

std::array<Expansion<16>, 3> cross(const ExactVector& a, const ExactVector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

ExactProduct dot(const std::array<float, 3>& a, const std::array<Expansion<16>, 3>& b) {
  return b[0] * double(a[0]) + b[1] * double(a[1]) + b[2] * double(a[2]);
}

ExactNumerator dot(const ExactVector& a, const std::array<Expansion<16>, 3>& b) {
  return b[0] * a[0] + b[1] * a[1] + b[2] * a[2];
}

// The edge functions, and with them whether the ray's line meets the triangle: it does where no two have opposite
// signs and not all are zero.
bool inside_exactly(const ExactRay& ray, const ExactCorners& corners, ExactHit& hit) {
  const ExactVector a = from_to(ray.org, corners[0]), b = from_to(ray.org, corners[1]),
                    c = from_to(ray.org, corners[2]);
  const FewParts u = compressed<kFewParts>(dot(ray.dir, cross(c, b)));
  const FewParts v = compressed<kFewParts>(dot(ray.dir, cross(a, c)));
  if (u.sign() * v.sign() < 0) {
    return false;
  }
  const FewParts w = compressed<kFewParts>(dot(ray.dir, cross(b, a)));
  if (u.sign() * w.sign() < 0 || v.sign() * w.sign() < 0) {
    return false;
  }
  // Of one sign: their sum is zero where all are, the ray in the plane or the triangle without area.
  const double det = u.estimate() + v.estimate() + w.estimate();
  hit.u = v.estimate() / det;
  hit.v = w.estimate() / det;
  return det != 0;
}

// The sign of an edge function that is zero, from p to q, where org moves by a step along axis x that is less than any
// number, and by one along y that is less than any fraction of that. With d = q - p it changes by -(dir_z d_y - dir_y
// d_z) for a step along x, by dir_z d_x - dir_x d_z for one along y.
int side_after_step(const std::array<float, 3>& dir, const std::array<float, 3>& p, const std::array<float, 3>& q) {
  const auto [x, y, z] = axes_of(dir);
  const ExactVector d = from_to(p, q);
  const int along_x = (d[y] * double(dir[z]) - d[z] * double(dir[y])).sign();
  return along_x != 0 ? -along_x : (d[x] * double(dir[z]) - d[z] * double(dir[x])).sign();
}

// Whether the line of the ray that has moved so meets the triangle. It meets no edge and no corner.
bool owns_exactly(const ExactRay& ray, const ExactCorners& corners, ExactHit& hit) {
  const ExactVector a = from_to(ray.org, corners[0]), b = from_to(ray.org, corners[1]),
                    c = from_to(ray.org, corners[2]);
  const auto side = [&](const FewParts& edge, unsigned from, unsigned to) {
    return edge.sign() != 0 ? edge.sign() : side_after_step(ray.dir, corners[from], corners[to]);
  };
  const FewParts u = compressed<kFewParts>(dot(ray.dir, cross(c, b)));
  const FewParts v = compressed<kFewParts>(dot(ray.dir, cross(a, c)));
  const FewParts w = compressed<kFewParts>(dot(ray.dir, cross(b, a)));
  const int of_u = side(u, 2, 1), of_v = side(v, 0, 2), of_w = side(w, 1, 0);
  if (of_u == 0 || of_u != of_v || of_v != of_w) {
    return false;
  }
  // Their sum does not change as org moves, so it is not zero.
  const double det = u.estimate() + v.estimate() + w.estimate();
  hit.u = v.estimate() / det;
  hit.v = w.estimate() / det;
  return true;
}

// t = over / under, under > 0.
struct ExactT {
  FewParts over, under;
  double estimate;  // off by less than 2^-50 of its magnitude
};

// The plane of v0 with normal N = (v1 - v0) x (v2 - v0): t = (v0 - org) . N / dir . N.
ExactT exact_t(const ExactRay& ray, const ExactCorners& corners) {
  const auto normal = cross(from_to(corners[0], corners[1]), from_to(corners[0], corners[2]));
  ExactT t{compressed<kFewParts>(dot(from_to(ray.org, corners[0]), normal)),
           compressed<kFewParts>(dot(ray.dir, normal)), 0};
  if (t.under.sign() < 0) {
    t.over = -t.over;
    t.under = -t.under;
  }
  t.estimate = t.over.estimate() / t.under.estimate();
  return t;
}

// The sign of t - x.
int compare(const ExactT& t, double x) {
  const double gap = t.estimate - x;
  if (std::fabs(gap) > 0x1p-48 * (std::fabs(t.estimate) + std::fabs(x))) {
    return gap > 0 ? 1 : -1;
  }
  return (t.over - t.under * x).sign();
}

// The float32 nearest to t, ties to even; +0 for zero.
float nearest_float(const ExactT& t) {
  const auto near = static_cast<float>(std::clamp(t.estimate, -double(kMostFloat), double(kMostFloat)));
  const bool odd = (std::bit_cast<std::uint32_t>(near) & 1) != 0;
  for (const float end : {-kMostFloat, kMostFloat}) {
    const float neighbour = std::nextafter(near, end);
    const double middle = 0.5 * (double(near) + double(neighbour));  // 25 bits: exact
    const int beyond = end < 0 ? -compare(t, middle) : compare(t, middle);
    if (neighbour != near && (beyond > 0 || (beyond == 0 && odd))) {
      return neighbour + 0.0F;
    }
  }
  return near + 0.0F;
}

bool place_exactly(const ExactRay& ray, const ExactCorners& corners, const ExactInterval& interval, ExactHit& hit) {
  const ExactT t = exact_t(ray, corners);
  if (compare(t, interval.tnear) < 0 || (!interval.tfar_is_hit && compare(t, interval.tfar) > 0)) {
    return false;
  }
  hit.t = nearest_float(t);
  return hit.t <= interval.tfar;
}

using InsideTest = bool(const ExactRay&, const ExactCorners&, ExactHit&);

bool hit_by(InsideTest& inside, const ExactRay& ray, const ExactCorners& corners, const ExactInterval& asked,
            ExactHit& hit) {
  const ExactInterval interval{std::max(asked.tnear, -kMostFloat), asked.tfar, asked.tfar_is_hit};
  if (interval.tnear > interval.tfar) {
    return false;
  }
  const RoughTest rough = test_roughly(ray, corners);
  switch (side_of(rough)) {
    case Side::outside:
      return false;
    case Side::unsure:
      return inside(ray, corners, hit) && place_exactly(ray, corners, interval, hit);
    case Side::inside:
      break;
  }
  hit.u = rough.v / rough.det;
  hit.v = rough.w / rough.det;
  const Verdict verdict = place_roughly(rough, interval, hit.t);
  return verdict == Verdict::hit || (verdict == Verdict::unsure && place_exactly(ray, corners, interval, hit));
}

}  // namespace

bool exact_hit(const ExactRay& ray, const ExactCorners& corners, const ExactInterval& interval, ExactHit& hit) {
  return hit_by(inside_exactly, ray, corners, interval, hit);
}

bool exact_crossing(const ExactRay& ray, const ExactCorners& corners, const ExactInterval& interval, ExactHit& hit) {
  return hit_by(owns_exactly, ray, corners, interval, hit);
}

int exact_order(const ExactRay& ray, const ExactCorners& a, const ExactCorners& b) {
  const ExactT of_a = exact_t(ray, a), of_b = exact_t(ray, b);
  const double gap = of_a.estimate - of_b.estimate;
  if (std::fabs(gap) > 0x1p-48 * (std::fabs(of_a.estimate) + std::fabs(of_b.estimate))) {
    return gap > 0 ? 1 : -1;
  }
  return (of_a.over * of_b.under - of_b.over * of_a.under).sign();
}

}  // namespace raymill::traversal
