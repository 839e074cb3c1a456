#include "tests/extremes/relief.h"

#include <cmath>
#include <cstdio>
#include <optional>

namespace raymill::extremes {
namespace {

__extension__ using Quad = __float128;
using QuadPoint = std::array<Quad, 3>;

constexpr unsigned kCells = Relief::kCells;

QuadPoint operator-(const QuadPoint& a, const QuadPoint& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
QuadPoint quad(const Point& p) { return {p[0], p[1], p[2]}; }
Quad dot(const QuadPoint& a, const QuadPoint& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
QuadPoint cross(const QuadPoint& a, const QuadPoint& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

QuadPoint corner(const Relief& relief, std::size_t triangle, std::size_t k) {
  const std::size_t at = 3 * std::size_t{relief.indices[3 * triangle + k]};
  QuadPoint p{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    p[axis] = relief.local.empty() ? Quad(relief.positions[at + axis])
                                   : Quad(relief.place[axis]) + Quad(relief.local[at + axis]);
  }
  return p;
}

// Moeller and Trumbore in quadruple precision.
std::optional<Quad> true_t(const Relief& relief, std::size_t triangle, const Ray64& ray) {
  const QuadPoint a = corner(relief, triangle, 0);
  const QuadPoint e1 = corner(relief, triangle, 1) - a, e2 = corner(relief, triangle, 2) - a;
  const QuadPoint dir = quad(ray.dir), s = quad(ray.org) - a;
  const QuadPoint p = cross(dir, e2), q = cross(s, e1);
  const Quad det = dot(e1, p);
  const Quad u = dot(s, p) / det, v = dot(dir, q) / det, t = dot(e2, q) / det;
  const bool hits = det != 0 && u >= 0 && v >= 0 && u + v <= 1 && t >= ray.tnear && t <= ray.tfar;
  return hits ? std::optional<Quad>(t) : std::nullopt;
}

// How far `p` lies off a triangle's plane.
double off_plane(const Relief& relief, std::size_t triangle, const QuadPoint& p) {
  const QuadPoint a = corner(relief, triangle, 0);
  const QuadPoint n = cross(corner(relief, triangle, 1) - a, corner(relief, triangle, 2) - a);
  return std::fabs(static_cast<double>(dot(n, p - a))) / std::sqrt(static_cast<double>(dot(n, n)));
}

std::vector<std::uint32_t> cells() {
  std::vector<std::uint32_t> indices;
  for (unsigned j = 0; j < kCells; ++j) {
    for (unsigned i = 0; i < kCells; ++i) {
      const unsigned a = j * (kCells + 1) + i, b = a + 1, c = a + kCells + 1, d = c + 1;
      indices.insert(indices.end(), {a, b, d, a, d, c});
    }
  }
  return indices;
}

// Calls put(x, y, z) for each corner, relative to the relief's place.
template <typename Put>
void each_corner(tests::Random& random, Put&& put) {
  for (unsigned j = 0; j <= kCells; ++j) {
    for (unsigned i = 0; i <= kCells; ++i) {
      put(i * kMillimetre, j * kMillimetre, random.below(4) * kMillimetre);
    }
  }
}

}  // namespace

Relief make_relief(tests::Random& random, const Point& place) {
  Relief relief{.place = place, .positions = {}, .local = {}, .indices = cells()};
  each_corner(random, [&](double x, double y, double z) {
    relief.positions.insert(relief.positions.end(), {place[0] + x, place[1] + y, place[2] + z});
  });
  return relief;
}

Relief make_local_relief(tests::Random& random, const Point& place) {
  Relief relief{.place = place, .positions = {}, .local = {}, .indices = cells()};
  each_corner(random, [&](double x, double y, double z) {
    relief.local.insert(relief.local.end(), {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z)});
  });
  return relief;
}

std::vector<Ray64> make_rays(tests::Random& random, const Point& place, double distance, std::size_t count) {
  std::vector<Ray64> rays;
  while (rays.size() < count) {
    const auto share = [&] { return double(random.uniform(-1, 1)); };
    const double along = 0.06 + 0.05 * share(), across = 0.06 + 0.05 * share();
    const Point target = {place[0] + along, place[1] + across, place[2] + 0.0015};
    const Point from = {target[0] + distance * share(), target[1] + distance * share(), target[2] + distance};
    rays.push_back({.org = from, .dir = {target[0] - from[0], target[1] - from[1], target[2] - from[2]}, .tfar = 1e30});
  }
  return rays;
}

// The relief is at most 3 mm high, so that only the cells below the ray's last few millimetres can be hit.
Truth true_hit(const Relief& relief, const Ray64& ray) {
  const double top = (relief.place[2] + 4 * kMillimetre - ray.org[2]) / ray.dir[2];
  const double bottom = (relief.place[2] - kMillimetre - ray.org[2]) / ray.dir[2];
  const auto cells = [&](std::size_t axis) {
    const double a = (ray.org[axis] - relief.place[axis] + top * ray.dir[axis]) / kMillimetre;
    const double b = (ray.org[axis] - relief.place[axis] + bottom * ray.dir[axis]) / kMillimetre;
    const auto within = [](double x) { return static_cast<unsigned>(std::clamp(x, 0.0, double(Relief::kCells - 1))); };
    return std::pair(within(std::min(a, b) - 1), within(std::max(a, b) + 1));
  };
  const auto [i0, i1] = cells(0);
  const auto [j0, j1] = cells(1);
  Truth best;
  for (std::size_t j = j0; j <= j1; ++j) {
    for (std::size_t i = i0; i <= i1; ++i) {
      for (std::size_t half = 0; half < 2; ++half) {
        const std::size_t triangle = 2 * (j * Relief::kCells + i) + half;
        const auto t = true_t(relief, triangle, ray);
        if (t && (best.t < 0 || *t < best.t)) {
          best = {triangle, *t};
        }
      }
    }
  }
  return best;
}

double Errors::median_t() {
  if (t.empty()) {
    return 0;
  }
  std::nth_element(t.begin(), t.begin() + std::ptrdiff_t(t.size() / 2), t.end());
  return t[t.size() / 2];
}

Errors errors_of(const Relief& relief, std::span<const Ray64> rays, std::span<const Truth> truths,
                 std::span<const Hit> hits) {
  Errors errors;
  errors.rays = rays.size();
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const bool is_hit = std::isfinite(hits[i].t);
    if (is_hit != (truths[i].t >= 0)) {
      ++errors.wrong_hits;
      continue;
    }
    if (!is_hit) {
      continue;
    }
    errors.wrong_triangles += hits[i].primitive_id != truths[i].triangle ? 1 : 0;
    const auto off = static_cast<double>(Quad(hits[i].t) - truths[i].t);
    const Point& d = rays[i].dir;
    const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    errors.t.push_back(std::fabs(off) * length);
    errors.most_t = std::max(errors.most_t, errors.t.back());
    // How far the point that a caller makes of t in float64 lies from the true one.
    double square = 0;
    QuadPoint point{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double ours = rays[i].org[axis] + double(hits[i].t) * d[axis];
      point[axis] = ours;
      const auto apart = static_cast<double>(Quad(ours) - (Quad(rays[i].org[axis]) + truths[i].t * d[axis]));
      square += apart * apart;
    }
    errors.most_place = std::max(errors.most_place, std::sqrt(square));
    errors.most_off = std::max(errors.most_off, off_plane(relief, hits[i].primitive_id, point));
  }
  return errors;
}

std::string line_of(const std::string& from, const std::string& who, Errors errors) {
  char text[256];
  std::snprintf(text, sizeof text, "| %s | %s | %zu of %zu | %zu | %.2g | %.2g | %.2g | %.2g |\n", from.c_str(),
                who.c_str(), errors.wrong_hits, errors.rays, errors.wrong_triangles, errors.median_t(), errors.most_t,
                errors.most_place, errors.most_off);
  return text;
}

}  // namespace raymill::extremes
