#include "tests/support/brute_force.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

namespace raymill::tests {
namespace {

using Vector = std::array<long double, 3>;

// Nearer to an edge than this, in barycentrics, the oracle does not judge.
constexpr long double kEdge = 1e-9L;

Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
long double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

long double ulp_of(long double value) {
  const float x = std::fabs(static_cast<float>(value));
  return std::nextafter(x, std::numeric_limits<float>::infinity()) - x;
}

std::string describe(const OracleHit& hit) {
  return "primitive " + std::to_string(hit.triangle->primitive_id) + " of geometry " +
         std::to_string(hit.triangle->geometry_id) + " at t " + std::to_string(hit.t);
}

}  // namespace

std::vector<OracleHit> oracle_hits(std::span<const storage::Triangle> triangles, const Ray& ray) {
  std::vector<OracleHit> hits;
  const Vector dir{ray.dir[0], ray.dir[1], ray.dir[2]};
  for (const storage::Triangle& triangle : triangles) {
    Vector e1, e2, s;
    for (int axis = 0; axis < 3; ++axis) {
      const auto i = static_cast<std::size_t>(axis);
      e1[i] = static_cast<long double>(triangle.v[1][axis]) - triangle.v[0][axis];
      e2[i] = static_cast<long double>(triangle.v[2][axis]) - triangle.v[0][axis];
      s[i] = static_cast<long double>(ray.org[i]) - triangle.v[0][axis];
    }
    const Vector p = cross(dir, e2), q = cross(s, e1);
    const long double det = dot(e1, p);
    if (det == 0) {
      continue;
    }
    OracleHit hit{&triangle, dot(e2, q) / det, dot(s, p) / det, dot(dir, q) / det, true};
    const long double least = std::min({hit.u, hit.v, 1 - hit.u - hit.v});
    const long double slack = 8 * ulp_of(hit.t);
    if (least < -kEdge || hit.t < ray.tnear - slack || hit.t > ray.tfar + slack) {
      continue;
    }
    hit.certain = least > kEdge && hit.t > ray.tnear + slack && hit.t < ray.tfar - slack;
    hits.push_back(hit);
  }
  std::sort(hits.begin(), hits.end(), [](const OracleHit& a, const OracleHit& b) { return a.t < b.t; });
  return hits;
}

std::string oracle_objects(std::span<const storage::Triangle> triangles, const Ray& ray, const Hit& hit,
                           double t_ulps) {
  const std::vector<OracleHit> hits = oracle_hits(triangles, ray);
  const auto sure = std::find_if(hits.begin(), hits.end(), [](const OracleHit& h) { return h.certain; });
  if (hit.primitive_id == kNoId) {
    return sure == hits.end() ? "" : "a miss, where the oracle hits " + describe(*sure);
  }
  const auto same = std::find_if(hits.begin(), hits.end(), [&](const OracleHit& h) {
    return h.triangle->primitive_id == hit.primitive_id && h.triangle->geometry_id == hit.geometry_id;
  });
  if (same == hits.end()) {
    return "a hit of a triangle that the ray passes by";
  }
  if (std::fabs(hit.t - same->t) > t_ulps * ulp_of(same->t)) {
    return "t is off by " + std::to_string(double((hit.t - same->t) / ulp_of(same->t))) + " ulp from " +
           describe(*same);
  }
  if (sure != hits.end() && hit.t > sure->t + t_ulps * ulp_of(sure->t)) {
    return "the oracle hits " + describe(*sure) + " before";
  }
  return "";
}

}  // namespace raymill::tests
