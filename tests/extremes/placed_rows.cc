// Objects that are placed by matrices of every kind: the answers of their flattened scenes, where float32 can hold
// these.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

#include "tests/extremes/row.h"

namespace raymill::extremes {
namespace {

using Wide = long double;
using WidePoint = std::array<Wide, 3>;
using Matrix = tests::PlacedScene::Matrix;

WidePoint cross(const WidePoint& a, const WidePoint& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
Wide dot(const WidePoint& a, const WidePoint& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
WidePoint minus(const WidePoint& a, const WidePoint& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
WidePoint column(const Matrix& m, std::size_t k) { return {m[4 * k], m[4 * k + 1], m[4 * k + 2]}; }

// By Cramer's rule.
WidePoint into_object(const Matrix& m, const WidePoint& v) {
  const WidePoint x = column(m, 0), y = column(m, 1), z = column(m, 2);
  const Wide det = dot(x, cross(y, z));
  return {dot(v, cross(y, z)) / det, dot(v, cross(z, x)) / det, dot(v, cross(x, y)) / det};
}

Matrix times(const Matrix& a, const Matrix& b) {
  Matrix product{};
  for (std::size_t k = 0; k < 4; ++k) {
    for (std::size_t row = 0; row < 4; ++row) {
      for (std::size_t i = 0; i < 4; ++i) {
        product[4 * k + row] += a[4 * i + row] * b[4 * k + i];
      }
    }
  }
  return product;
}

// x, y and z are the columns of the 3 x 3 part.
Matrix matrix(const std::array<double, 3>& x, const std::array<double, 3>& y, const std::array<double, 3>& z,
              const std::array<double, 3>& offset) {
  return {x[0], x[1], x[2], 0, y[0], y[1], y[2], 0, z[0], z[1], z[2], 0, offset[0], offset[1], offset[2], 1};
}

struct Placing {
  const char* name;
  Matrix matrix;
};

// The last two columns of the near-singular one are all but the same; its determinant is 2^-8 of its columns' box.
std::vector<Placing> placings() {
  const Matrix turned = matrix({0.6, 0.8, 0}, {-0.8, 0.6, 0}, {0, 0, 1}, {3, -2, 1});
  const Matrix stretched = matrix({2, 0, 0}, {0, 0.25, 0}, {0, 0, 3}, {0, 5, 0});
  return {{"moved by 1e6", matrix({1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1e6, -1e6, 1e6})},
          {"scaled by 1e-6", matrix({1e-6, 0, 0}, {0, 1e-6, 0}, {0, 0, 1e-6}, {0, 0, 0})},
          {"three matrices deep", times(times(turned, stretched), turned)},
          {"mirrored", matrix({-1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {40, 0, 0})},
          {"sheared", matrix({1, 0, 0}, {0.75, 1, 0}, {0.5, 2, 1}, {0, 40, 0})},
          {"all but singular", matrix({1, 0, 0}, {0, 1, 0}, {0, 1, 0x1p-8}, {0, 0, 40})}};
}

// From ten radii of the sphere away at its centroids; where they start is rounded to float32 in the world.
std::vector<Ray> rays_at(const Placing& placing, const Mesh& mesh, std::size_t count) {
  Random random(23);
  const auto in_world = [&](const Vec3f& p) {
    std::array<double, 3> out{};
    for (std::size_t row = 0; row < 3; ++row) {
      out[row] = placing.matrix[row] * p.x + placing.matrix[4 + row] * p.y + placing.matrix[8 + row] * p.z +
                 placing.matrix[12 + row];
    }
    return out;
  };
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const Corners& c = mesh[random.below(static_cast<std::uint32_t>(mesh.size()))];
    Vec3f target;
    for (int axis = 0; axis < 3; ++axis) {
      target[axis] = (c[0][axis] + c[1][axis] + c[2][axis]) / 3;
    }
    const Vec3f d = random.direction();
    const auto from = in_world({10 * d.x, 10 * d.y, 10 * d.z}), to = in_world(target);
    Ray& ray = rays.emplace_back();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      ray.org[axis] = static_cast<float>(from[axis]);
      ray.dir[axis] = static_cast<float>(to[axis] - double(ray.org[axis]));
    }
  }
  return rays;
}

// Against float64: hits for misses, and how far t is off; t is about 1.
struct Against {
  std::size_t different = 0;
  double most = 0;
};
Against against_truth(const Answers& answers) {
  Against against;
  for (std::size_t i = 0; i < std::min(answers.hits.size(), answers.truth.size()); ++i) {
    const float ours = answers.hits[i].t, truth = answers.truth[i].t;
    if (std::isfinite(ours) != std::isfinite(truth)) {
      ++against.different;
    } else if (std::isfinite(ours)) {
      against.most = std::max(against.most, std::fabs(double(ours) - truth));
    }
  }
  return against;
}

Row placed(const Placing& placing) {
  constexpr double kBound = 1e-4;
  const Mesh mesh = tests::sphere({}, 1, 12, 24);
  const auto tell = [](const Answers& answers) {
    const Against against = against_truth(answers);
    char text[96];
    std::snprintf(text, sizeof text, "%zu of %zu not as float64, t off by up to %.1g", against.different,
                  answers.truth.size(), against.most);
    return std::string(text);
  };
  return {.id = "E23",
          .setup = std::string("sphere of radius 1, placed: ") + placing.name + "; from ten radii away at centroids",
          .promise = "hits and misses as float64, t off by at most 1e-4 of the way",
          .placed = tests::PlacedScene{.world = {}, .objects = {{mesh}}, .places = {{0, placing.matrix}}},
          .rays = [placing, mesh](auto) { return rays_at(placing, mesh, 600); },
          .tell = tell,
          .keeps =
              [](Mode, const Answers& answers) {
                const Against against = against_truth(answers);
                return against.different == 0 && against.most <= kBound;
              }};
}

}  // namespace

Hit placed_truth(const tests::PlacedScene& scene, const Ray& ray) {
  Hit best;
  std::uint32_t geometry = 0;
  for (const auto& place : scene.places) {
    const Matrix& m = place.world_from_object;
    const WidePoint offset{m[12], m[13], m[14]};
    const WidePoint org = into_object(m, minus({ray.org[0], ray.org[1], ray.org[2]}, offset));
    const WidePoint dir = into_object(m, {ray.dir[0], ray.dir[1], ray.dir[2]});
    for (const Mesh& mesh : scene.objects[place.object]) {
      for (std::size_t i = 0; i < mesh.size(); ++i) {
        const auto wide = [&](std::size_t k) { return WidePoint{mesh[i][k].x, mesh[i][k].y, mesh[i][k].z}; };
        const WidePoint e1 = minus(wide(1), wide(0)), e2 = minus(wide(2), wide(0)), s = minus(org, wide(0));
        const WidePoint p = cross(dir, e2), q = cross(s, e1);
        const Wide det = dot(e1, p), u = dot(s, p) / det, v = dot(dir, q) / det, t = dot(e2, q) / det;
        if (det != 0 && u >= 0 && v >= 0 && u + v <= 1 && t >= ray.tnear && t <= ray.tfar && t < best.t) {
          best = {static_cast<float>(t), static_cast<float>(u), static_cast<float>(v), static_cast<std::uint32_t>(i),
                  geometry};
        }
      }
      ++geometry;
    }
  }
  return best;
}

std::vector<Row> placed_rows() {
  std::vector<Row> rows;
  for (const Placing& placing : placings()) {
    rows.push_back(placed(placing));
  }
  return rows;
}

}  // namespace raymill::extremes
