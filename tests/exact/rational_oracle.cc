#include "tests/exact/rational_oracle.h"

#include <gmpxx.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

namespace raymill::tests {
namespace {

using Integers = std::array<mpz_class, 3>;

// Every finite float32 is an integer in units of 2^-149.
constexpr int kUnit = 149;

mpz_class whole(float x) { return mpz_class(std::ldexp(double(x), kUnit)); }

template <typename Point>
Integers whole(const Point& p) {
  return {whole(p[0]), whole(p[1]), whole(p[2])};
}

Integers operator-(const Integers& a, const Integers& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
Integers cross(const Integers& a, const Integers& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
mpz_class dot(const Integers& a, const Integers& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// t, u, v times det, which is positive.
struct Quotients {
  mpz_class det, t, u, v;
};

bool meets(const Integers& org, const Integers& dir, const storage::Triangle& triangle, Quotients& out) {
  const Integers v0 = whole(triangle.v[0]);
  const Integers e1 = whole(triangle.v[1]) - v0, e2 = whole(triangle.v[2]) - v0, s = org - v0;
  const Integers p = cross(dir, e2), q = cross(s, e1);
  out = {dot(e1, p), dot(e2, q), dot(s, p), dot(dir, q)};
  if (out.det < 0) {
    out = {-out.det, -out.t, -out.u, -out.v};
  }
  return out.det > 0 && out.u >= 0 && out.v >= 0 && out.u + out.v <= out.det;
}

int order(const Quotients& q, float x) { return cmp(mpz_class(q.t << kUnit), mpz_class(whole(x) * q.det)); }

// over / under to the nearest float32, ties to even.
float nearest_quotient(mpz_class over, const mpz_class& under) {
  const bool negative = over < 0;
  over = abs(over);
  if (over == 0) {
    return 0;
  }
  // 26 or 27 bits of the quotient, and whether there are more.
  const long bits = long(mpz_sizeinbase(over.get_mpz_t(), 2)) - long(mpz_sizeinbase(under.get_mpz_t(), 2));
  const long shift = 26 - bits;
  const mpz_class left = shift > 0 ? mpz_class(over << shift) : over;
  const mpz_class right = shift < 0 ? mpz_class(under << -shift) : under;
  const mpz_class quotient = left / right;
  const bool more = quotient * right != left;
  const long ulp = std::max(long(mpz_sizeinbase(quotient.get_mpz_t(), 2)) - 24 - shift, -long(kUnit));
  const long drop = ulp + shift;
  if (drop > 40) {
    return 0;
  }
  const unsigned long digits = quotient.get_ui(), half = 1UL << (drop - 1), rest = digits & (2 * half - 1);
  unsigned long kept = digits >> drop;
  kept += rest > half || (rest == half && (more || (kept & 1) != 0)) ? 1 : 0;
  const float value = std::ldexp(float(kept), int(ulp)) + 0.0F;
  return negative && value != 0 ? -value : value;
}

float quotient_near(const mpz_class& over, const mpz_class& under) {
  return static_cast<float>(mpq_class(over, under).get_d());
}

}  // namespace

Hit rational_closest(std::span<const storage::Triangle> triangles, const Ray& ray) {
  constexpr float kMost = std::numeric_limits<float>::max();
  const float tnear = std::max(ray.tnear, -kMost), tfar = std::min(ray.tfar, kMost);
  Hit hit;
  if (!(tnear <= tfar)) {
    return hit;
  }
  const Integers org = whole(ray.org), dir = whole(ray.dir);
  Quotients best, next;
  for (const storage::Triangle& triangle : triangles) {
    if (!meets(org, dir, triangle, next) || order(next, tnear) < 0 || order(next, tfar) > 0) {
      continue;
    }
    if (hit.primitive_id != kNoId) {
      const int later = cmp(mpz_class(next.t * best.det), mpz_class(best.t * next.det));
      const auto ids = std::tuple(triangle.geometry_id, triangle.primitive_id);
      if (later > 0 || (later == 0 && ids > std::tuple(hit.geometry_id, hit.primitive_id))) {
        continue;
      }
    }
    best = next;
    hit.geometry_id = triangle.geometry_id;
    hit.primitive_id = triangle.primitive_id;
  }
  if (hit.primitive_id != kNoId) {
    hit.t = nearest_quotient(best.t, best.det);
    hit.u = quotient_near(best.u, best.det);
    hit.v = quotient_near(best.v, best.det);
  }
  return hit;
}

bool agrees(const Hit& hit, const Hit& oracle) {
  constexpr float kNear = 0x1p-21F;
  return hit.t == oracle.t && std::signbit(hit.t) == std::signbit(oracle.t) &&
         hit.primitive_id == oracle.primitive_id && hit.geometry_id == oracle.geometry_id &&
         std::fabs(hit.u - oracle.u) <= kNear && std::fabs(hit.v - oracle.v) <= kNear && hit.u >= 0 && hit.v >= 0 &&
         hit.u + hit.v <= 1;
}

}  // namespace raymill::tests
