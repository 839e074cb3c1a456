// Level sets of volumes: along axes, past them to infinity, both ways, over the widest interval, from the faces of
// voxels.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>

#include "tests/extremes/row.h"

namespace raymill::extremes {
namespace {

constexpr int kCells = 64;
constexpr float kCell = 1.0F / kCells;
constexpr storage::Point3 kCentre = {0.501, 0.4993, 0.5007};
constexpr double kRadius = 0.3;

tests::TestVolume ball() { return tests::ball(kCells, kCentre, kRadius); }

// How many are hit or missed as by float64, and how far the others' t is from it, in steps of float32.
std::string tell_steps(const Answers& answers) {
  std::size_t alike = 0;
  std::int64_t steps = 0;
  for (std::size_t i = 0; i < answers.truth.size(); ++i) {
    const float t = answers.hits[i].t, expected = answers.truth[i].t;
    if (std::isfinite(t) != std::isfinite(expected)) {
      continue;
    }
    ++alike;
    if (std::isfinite(t)) {
      const std::int64_t apart = std::int64_t{std::bit_cast<std::int32_t>(t)} - std::bit_cast<std::int32_t>(expected);
      steps = std::max(steps, std::abs(apart));
    }
  }
  char text[96];
  std::snprintf(text, sizeof text, "%zu of %zu as float64, t off by up to %lld steps", alike, answers.truth.size(),
                static_cast<long long>(steps));
  return text;
}

bool is_as_truth(Mode /*any*/, const Answers& answers) {
  const std::string words = tell_steps(answers);
  const std::string all = std::to_string(answers.truth.size()) + " of " + std::to_string(answers.truth.size());
  return words == all + " as float64, t off by up to 0 steps" || words == all + " as float64, t off by up to 1 steps";
}

Row volume_row(const std::string& setup, const std::string& promise,
               std::function<std::vector<Ray>(std::span<const Triangle>)> rays) {
  Row row;
  row.id = "E31";
  row.setup = "ball in a level set of 64 x 64 x 64 voxels: " + setup;
  row.promise = promise;
  row.volume = ball();
  row.rays = std::move(rays);
  row.tell = tell_steps;
  row.keeps = is_as_truth;
  return row;
}

// Both ways along each axis, with zeros of both signs across it; on planes of voxels and between them.
std::vector<Ray> axis_rays() {
  std::vector<Ray> rays;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float way : {1.0F, -1.0F}) {
      for (unsigned signs = 0; signs < 4; ++signs) {
        for (const float at : {0.5F, 0.5F + kCell, 0.5F + 0.3F * kCell, 0.4371F}) {
          Ray ray;
          ray.org = {at, at, at};
          ray.org[axis] = way > 0 ? -1.0F : 2.0F;
          ray.dir = {0, 0, 0};
          ray.dir[(axis + 1) % 3] = (signs & 1U) != 0 ? -0.0F : 0.0F;
          ray.dir[(axis + 2) % 3] = (signs & 2U) != 0 ? -0.0F : 0.0F;
          ray.dir[axis] = way;
          rays.push_back(ray);
        }
      }
    }
  }
  return rays;
}

std::array<float, 3> direction(Random& random) {
  return {random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)};
}

// From outside of the box, away from it and past it, without an end.
std::vector<Ray> passing_rays() {
  Random random(31);
  std::vector<Ray> rays;
  while (rays.size() < 300) {
    Ray ray{.org = {random.uniform(-2, 3), random.uniform(-2, 3), 1.5F}, .dir = direction(random)};
    ray.dir[2] = rays.size() % 3 == 0 ? 0.0F : std::fabs(ray.dir[2]);
    rays.push_back(ray);
  }
  // Through the box, beside the ball.
  for (std::size_t axis = 0; axis < 3; ++axis) {
    Ray ray{.org = {0.9F, 0.9F, 0.9F}, .dir = {0, 0, 0}};
    ray.org[axis] = -3;
    ray.dir[axis] = 1;
    rays.push_back(ray);
  }
  return rays;
}

// Two points outside, through the ball: from one to the other, and back.
std::vector<Ray> reversed_rays() {
  Random random(32);
  std::vector<Ray> rays;
  while (rays.size() < 400) {
    const std::array<float, 3> dir = direction(random);
    Ray there, back;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float through = static_cast<float>(kCentre[axis]) + random.uniform(-0.15F, 0.15F);
      there.org[axis] = through - 2 * dir[axis];
      back.org[axis] = through + 2 * dir[axis];
      there.dir[axis] = dir[axis];
      back.dir[axis] = -dir[axis];
    }
    rays.push_back(there);
    rays.push_back(back);
  }
  return rays;
}

std::vector<Ray> wide_rays() {
  std::vector<Ray> rays = reversed_rays();
  rays.resize(200);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const float scale = std::ldexp(1.0F, static_cast<int>(i % 7) * 20 - 60);
    for (float& x : rays[i].dir) {
      x *= scale;
    }
    rays[i].tnear = 1e-9F;
    rays[i].tfar = 1e38F;
  }
  return rays;
}

// Multiples of a voxel on one, two or all axes, inside of the ball and outside; along axes and across.
std::vector<Ray> rays_from_faces() {
  Random random(33);
  std::vector<Ray> rays;
  while (rays.size() < 600) {
    const auto on = static_cast<unsigned>(rays.size() % 7 + 1);
    Ray ray{.org = {}, .dir = direction(random)};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float cell = static_cast<float>(random.below(kCells - 4) + 2);
      ray.org[axis] = ((on >> axis & 1U) != 0 ? cell : cell + random.uniform(0.01F, 0.99F)) * kCell;
    }
    if (rays.size() % 5 == 0) {
      const float way = ray.dir[0] < 0 ? -1.0F : 1.0F;
      ray.dir = {0, 0, 0};
      ray.dir[rays.size() / 5 % 3] = way;
    }
    rays.push_back(ray);
  }
  return rays;
}

Row empty_row() {
  Row row;
  row.id = "E31";
  row.setup = "a grid without a voxel beside a triangle";
  row.promise = "left out and counted, the rest intact";
  row.volume = ball();
  row.volume->grid.active_voxels = 0;
  row.scene = {{{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}}};
  row.rays = [](std::span<const Triangle>) {
    return std::vector<Ray>{{.org = {0.25F, 0.25F, 1}, .dir = {0, 0, -1}}, {.org = {0.5F, 0.5F, 9}, .dir = {0, 0, 1}}};
  };
  row.tell = tell_distances;
  row.keeps = always(tell_distances, "1, miss");
  row.not_for_embree = "nothing to ask";
  return row;
}

}  // namespace

Hit volume_truth(const tests::TestVolume& volume, const Ray& ray) {
  const tests::Way way = tests::way_through(volume, ray);
  const auto is_inside = [&](double t) { return tests::field_at(volume, ray, t) < 0; };
  // Where it comes to a plane of voxels: between two of them the field is one cubic.
  std::vector<double> borders = {way.begin, way.end};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (int plane = 0; plane <= kCells && ray.dir[axis] != 0; ++plane) {
      const double t = (double(plane) / kCells - double(ray.org[axis])) / double(ray.dir[axis]);
      if (t > way.begin && t < way.end) {
        borders.push_back(t);
      }
    }
  }
  std::sort(borders.begin(), borders.end());
  constexpr int kParts = 32;
  for (std::size_t i = 1; i < borders.size() && way.begin < way.end; ++i) {
    const double part = (borders[i] - borders[i - 1]) / kParts;
    for (int k = 0; k < kParts; ++k) {
      double a = borders[i - 1] + k * part, b = a + part;
      const bool inside = is_inside(a);
      if (is_inside(b) == inside) {
        continue;
      }
      for (int halving = 0; halving < 80; ++halving) {
        const double middle = a + (b - a) / 2;
        (is_inside(middle) == inside ? a : b) = middle;
      }
      return {.t = static_cast<float>(b), .primitive_id = 0, .geometry_id = 0};
    }
  }
  return {};
}

std::vector<Row> volume_rows() {
  const auto made = [](std::vector<Ray> (*make)()) { return [make](std::span<const Triangle>) { return make(); }; };
  return {volume_row("along axes, dir with zeros of both signs, on planes of voxels and between",
                     "hits as float64, t at most a step off", made(axis_rays)),
          volume_row("past it without an end", "no hit, and an end", made(passing_rays)),
          volume_row("200 rays through it and the same reversed", "hits as float64, t at most a step off",
                     made(reversed_rays)),
          volume_row("tnear 1e-9, tfar 1e38, dir of length 2^-60 to 2^60", "hits as float64, t at most a step off",
                     made(wide_rays)),
          volume_row("origins on faces, edges and corners of voxels, inside and outside",
                     "hits as float64, t at most a step off", made(rays_from_faces)),
          empty_row()};
}

}  // namespace raymill::extremes
