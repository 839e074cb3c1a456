#include "tests/bench/leaks/closed_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "storage/base/position_map.h"
#include "storage/import/triangle_filter.h"

namespace raymill::bench {
namespace {

// A triangle's corners by the numbers of their positions.
using Numbers = std::array<std::uint32_t, 3>;

std::vector<Numbers> numbered(const Mesh& mesh) {
  storage::PositionMap positions;
  std::vector<Numbers> triangles;
  for (const Corners& corners : mesh) {
    triangles.push_back({positions.insert(corners[0]), positions.insert(corners[1]), positions.insert(corners[2])});
  }
  return triangles;
}

// An edge of one triangle: its ends, the lower number first, and whether it is passed upwards.
struct Side {
  std::uint32_t low, high;
  bool up;
  std::size_t triangle;
  [[nodiscard]] bool same_edge(const Side& other) const { return low == other.low && high == other.high; }
};

bool before(const Side& a, const Side& b) { return a.low != b.low ? a.low < b.low : a.high < b.high; }

// Those of one edge come together.
std::vector<Side> sides_of(const std::vector<Numbers>& triangles) {
  std::vector<Side> sides;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = triangles[i][k], b = triangles[i][(k + 1) % 3];
      sides.push_back({std::min(a, b), std::max(a, b), a < b, i});
    }
  }
  std::sort(sides.begin(), sides.end(), before);
  return sides;
}

// Calls take(first, last, upwards, downwards) for each edge.
template <typename Take>
void for_each_edge(const std::vector<Side>& sides, Take&& take) {
  for (auto first = sides.begin(); first != sides.end();) {
    const auto last = std::find_if(first, sides.end(), [&](const Side& side) { return !side.same_edge(*first); });
    const auto up = std::count_if(first, last, [](const Side& side) { return side.up; });
    take(first, last, up, (last - first) - up);
    first = last;
  }
}

class Parts {
 public:
  explicit Parts(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0U); }
  std::uint32_t of(std::uint32_t i) {
    while (parent_[i] != i) {
      i = parent_[i] = parent_[parent_[i]];
    }
    return i;
  }
  void join(std::uint32_t a, std::uint32_t b) { parent_[of(a)] = of(b); }

 private:
  std::vector<std::uint32_t> parent_;
};

double length(const std::array<double, 3>& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }
double dot(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// From a triangle's centroid against its normal, up to the part `share` of the triangle's size.
Vec3f behind(const Corners& c, float share) {
  const Vec3f u{c[1].x - c[0].x, c[1].y - c[0].y, c[1].z - c[0].z},
      v{c[2].x - c[0].x, c[2].y - c[0].y, c[2].z - c[0].z};
  const Vec3f n{u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
  const float size = std::sqrt(std::sqrt(n.x * n.x + n.y * n.y + n.z * n.z)) + 1e-30F;
  Vec3f p;
  for (int axis = 0; axis < 3; ++axis) {
    p[axis] = (c[0][axis] + c[1][axis] + c[2][axis]) / 3 - n[axis] / size * share;
  }
  return p;
}

// Takes triangles without area out of a mesh, a few independent ones at a time.
class FlatTriangles {
 public:
  explicit FlatTriangles(const Mesh& mesh) : triangles_(numbered(mesh)) {
    positions_.resize(3 * mesh.size());
    for (std::size_t i = 0; i < mesh.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        positions_[triangles_[i][k]] = mesh[i][k];
      }
    }
  }

  // Whether anything changed.
  bool flip_some() {
    std::erase_if(triangles_, [](const Numbers& t) { return t[0] == t[1] || t[1] == t[2] || t[2] == t[0]; });
    const std::vector<Side> sides = sides_of(triangles_);
    std::vector<bool> changed(triangles_.size());
    bool any = false;
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      if (!changed[i] && is_flat(triangles_[i])) {
        any = flip(i, sides, changed) || any;
      }
    }
    return any;
  }

  [[nodiscard]] Mesh take() const {
    Mesh mesh;
    for (const Numbers& t : triangles_) {
      mesh.push_back(corners_of(t));
    }
    return mesh;
  }

 private:
  [[nodiscard]] Corners corners_of(const Numbers& t) const {
    return {positions_[t[0]], positions_[t[1]], positions_[t[2]]};
  }
  [[nodiscard]] bool is_flat(const Numbers& t) const {
    return storage::judge(corners_of(t)) == storage::TriangleVerdict::degenerate;
  }
  [[nodiscard]] double distance(std::uint32_t a, std::uint32_t b) const {
    const Vec3f &p = positions_[a], &q = positions_[b];
    return length({double(p.x) - q.x, double(p.y) - q.y, double(p.z) - q.z});
  }

  // (p, q, m) with m between p and q, and (q, p, d) beside it become (m, p, d) and (q, m, d).
  bool flip(std::size_t i, const std::vector<Side>& sides, std::vector<bool>& changed) {
    Numbers t = triangles_[i];
    for (int turn = 0; turn < 2; ++turn) {
      if (distance(t[0], t[1]) < std::max(distance(t[1], t[2]), distance(t[2], t[0]))) {
        t = {t[1], t[2], t[0]};
      }
    }
    const auto [p, q, m] = t;
    const Side wanted{std::min(p, q), std::max(p, q), p > q, 0};
    for (auto side = std::lower_bound(sides.begin(), sides.end(), wanted, before);
         side != sides.end() && side->same_edge(wanted); ++side) {
      if (side->up != wanted.up || changed[side->triangle] || side->triangle == i) {
        continue;
      }
      const Numbers& other = triangles_[side->triangle];
      const std::uint32_t d = other[0] != p && other[0] != q   ? other[0]
                              : other[1] != p && other[1] != q ? other[1]
                                                               : other[2];
      changed[i] = changed[side->triangle] = true;
      triangles_[i] = {m, p, d};
      triangles_[side->triangle] = {q, m, d};
      return true;
    }
    return false;
  }

  std::vector<Numbers> triangles_;
  std::vector<Vec3f> positions_;  // by number
};

}  // namespace

Edges edges_of(const Mesh& mesh) {
  Edges edges;
  for_each_edge(sides_of(numbered(mesh)), [&](auto, auto, auto up, auto down) {
    ++edges.count;
    (up != down ? edges.unpaired : up == 1 ? edges.by_two : edges.by_more) += 1;
  });
  return edges;
}

Mesh closed_parts(const Mesh& mesh) {
  const std::vector<Numbers> triangles = numbered(mesh);
  std::uint32_t vertices = 0;
  for (const Numbers& corners : triangles) {
    vertices = std::max({vertices, corners[0] + 1, corners[1] + 1, corners[2] + 1});
  }
  Parts parts(vertices);
  for (const Numbers& corners : triangles) {
    parts.join(corners[0], corners[1]);
    parts.join(corners[1], corners[2]);
  }
  std::vector<bool> open(vertices);
  for_each_edge(sides_of(triangles), [&](auto first, auto, auto up, auto down) {
    if (up != down) {
      open[parts.of(first->low)] = true;
    }
  });
  Mesh closed;
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    if (!open[parts.of(triangles[i][0])]) {
      closed.push_back(mesh[i]);
    }
  }
  return closed;
}

Mesh without_flat_triangles(const Mesh& mesh) {
  constexpr int kMostRounds = 100;  // each leaves fewer; two on one line could take turns
  FlatTriangles flat(mesh);
  for (int round = 0; round < kMostRounds && flat.flip_some(); ++round) {
  }
  return flat.take();
}

double winding_number(const Mesh& mesh, const Vec3f& p) {
  double sum = 0;
  for (const Corners& corners : mesh) {
    std::array<std::array<double, 3>, 3> v;
    for (std::size_t k = 0; k < 3; ++k) {
      v[k] = {double(corners[k].x) - p.x, double(corners[k].y) - p.y, double(corners[k].z) - p.z};
    }
    const double volume = v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1]) +
                          v[0][1] * (v[1][2] * v[2][0] - v[1][0] * v[2][2]) +
                          v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
    const double a = length(v[0]), b = length(v[1]), c = length(v[2]);
    sum += 2 * std::atan2(volume, a * b * c + dot(v[0], v[1]) * c + dot(v[1], v[2]) * a + dot(v[2], v[0]) * b);
  }
  return sum / (4 * 3.14159265358979323846);
}

std::vector<Vec3f> inside_points(const Mesh& mesh, tests::Random& random, std::size_t count, float step) {
  std::vector<Vec3f> points;
  for (std::size_t tries = 0; points.size() < count && tries < 50 * count; ++tries) {
    const auto any = [&]() -> const Corners& { return mesh[random.below(static_cast<std::uint32_t>(mesh.size()))]; };
    Vec3f p = behind(any(), random.uniform(0.5F, 4));
    if (random.below(2) == 0) {  // deeper inside
      const Vec3f& other = any()[0];
      const float part = random.uniform(0, 1);
      p = {p.x + (other.x - p.x) * part, p.y + (other.y - p.y) * part, p.z + (other.z - p.z) * part};
    }
    for (int axis = 0; axis < 3 && step != 0; ++axis) {
      p[axis] = std::nearbyint(p[axis] / step) * step;
    }
    // A point on the surface has half a winding: it is left out too.
    const double winding = winding_number(mesh, p);
    if (std::fabs(winding) > 0.5 && std::fabs(winding - std::nearbyint(winding)) < 1e-3) {
      points.push_back(p);
    }
  }
  return points;
}

}  // namespace raymill::bench
