// Meeting: where a ray meets a triangle, by exact arithmetic as far as 113 bits give it, and whether float64 can tell.
//
// Coordinates are float32, so corner - org and the products of the edge functions fit 113 bits but for extreme ranges.
// Edges and corners belong to the triangle; a ray in the triangle's plane does not meet it. Pure functions.
#pragma once

#include <cmath>

#include "storage/base/vec3.h"
#include "traversal/query.h"

namespace raymill::trial {

using Quad = __float128;

struct Meeting {
  bool hit = false;   ///< by exact arithmetic, the ray taken as a line
  bool near = false;  ///< so close to an edge, or to lying in the plane, that float64 may say the opposite
  Quad t = 0;         ///< where hit or near
  Quad u = 0, v = 0;
  double t_error = 0;  ///< that a float64 computation of t may be off by
  [[nodiscard]] bool possible() const { return hit || near; }
};

/// The spacing of float32 at |x|.
inline double ulp32(double x) {
  const double magnitude = std::fmax(std::fabs(x), 0x1p-126);
  return std::ldexp(1.0, std::ilogb(magnitude) - 23);
}

inline Quad magnitude(Quad x) { return x < 0 ? -x : x; }

// Sheared as Woop, Benthin, Wald 2013: the ray runs along z.
//
// In float64 (u = 2^-53), with L the largest |x|, |y| and Z the largest |z|: a sheared coordinate has four roundings of
// values of at most L + Z, so an edge function Cx*By - Cy*Bx is off by at most 4 * 4u (L + Z) L + 6u L^2 < 2^-48 L (L +
// Z). A float64 sign is trusted only beyond that; the rest is decided in 113 bits.
inline Meeting meet(const Ray& ray, const storage::Triangle& triangle) {
  int kz = 0;
  for (int axis = 1; axis < 3; ++axis) {
    kz = std::fabs(ray.dir[axis]) > std::fabs(ray.dir[kz]) ? axis : kz;
  }
  const int kx = (kz + 1) % 3, ky = (kx + 1) % 3;
  const double dz = ray.dir[kz], sx = ray.dir[kx] / dz, sy = ray.dir[ky] / dz;
  double x[3], y[3], z[3], size = 0, depth = 0;
  for (int k = 0; k < 3; ++k) {
    z[k] = double(triangle.v[k][kz]) - ray.org[kz];
    x[k] = double(triangle.v[k][kx]) - ray.org[kx] - sx * z[k];
    y[k] = double(triangle.v[k][ky]) - ray.org[ky] - sy * z[k];
    size = std::fmax(size, std::fmax(std::fabs(x[k]), std::fabs(y[k])));
    depth = std::fmax(depth, std::fabs(z[k]));
  }
  const double bound = 0x1p-48 * size * (size + depth);
  const double u = x[2] * y[1] - y[2] * x[1], v = x[0] * y[2] - y[0] * x[2], w = x[1] * y[0] - y[1] * x[0];
  if ((u < -bound || v < -bound || w < -bound) && (u > bound || v > bound || w > bound)) {
    return {};
  }

  // Exactly: the edge functions are triple products of dir and two corners, over dz.
  Quad p[3][3], edge[3];
  for (int k = 0; k < 3; ++k) {
    for (int axis = 0; axis < 3; ++axis) {
      p[k][axis] = Quad(triangle.v[k][axis]) - ray.org[axis];
    }
  }
  bool positive = false, negative = false, close = false;
  for (int k = 0; k < 3; ++k) {
    const Quad* b = p[(k + 1) % 3];
    const Quad* c = p[(k + 2) % 3];
    edge[k] = (ray.dir[0] * (c[1] * b[2] - c[2] * b[1]) + ray.dir[1] * (c[2] * b[0] - c[0] * b[2]) +
               ray.dir[2] * (c[0] * b[1] - c[1] * b[0])) /
              dz;
    positive |= edge[k] > 0;
    negative |= edge[k] < 0;
    close |= magnitude(edge[k]) <= bound;
  }
  const Quad det = edge[0] + edge[1] + edge[2];
  if (det == 0) {
    return {};
  }
  Meeting meeting;
  meeting.hit = !(positive && negative);
  meeting.near = close || magnitude(det) <= 3 * Quad(bound);
  if (!meeting.hit) {
    // Edge functions far from zero on both sides are a miss in float64 too.
    bool sure_positive = false, sure_negative = false;
    for (const Quad& e : edge) {
      sure_positive |= e > bound;
      sure_negative |= e < -bound;
    }
    meeting.near = !(sure_positive && sure_negative);
  }
  meeting.t = (edge[0] * p[0][kz] + edge[1] * p[1][kz] + edge[2] * p[2][kz]) / (det * dz);
  meeting.u = edge[1] / det;
  meeting.v = edge[2] / det;
  meeting.t_error = double((4 * bound * depth) / magnitude(det * dz)) + 0x1p-50 * std::fabs(double(meeting.t));
  return meeting;
}

}  // namespace raymill::trial
