// Closed and curved meshes: nothing may pass, near or far.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <limits>

#include "tests/extremes/row.h"
#include "tests/support/brute_force.h"

namespace raymill::extremes {
namespace {

using tests::ray_towards;

Row far_sphere() {
  const Vec3f center{148376, 1234, -223423};
  return {.id = "E3",
          .setup = "sphere of radius 2, 200 x 200, 270 000 units out; from random points inside",
          .promise = "no miss in watertight and exact",
          .scene = {tests::sphere(center, 2, 200, 200)},
          .rays = [center](auto) { return rays_from_inside(3, center, 1, 2500); },
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

Row far_plane() {
  Mesh mesh = tests::grid(200);
  for (Corners& corners : mesh) {
    for (Vec3f& p : corners) {
      p = {148376, p.x * 12 - 6, p.y * 12 - 6};
    }
  }
  const auto rays = [](auto) {
    Random random(4);
    std::vector<Ray> made;
    for (int i = 0; i < 2500; ++i) {
      const float y = random.uniform(-1, 1), z = random.uniform(-1, 1), dy = random.uniform(-0.5F, 0.5F);
      made.push_back(tests::ray({148373, y, z}, {1, dy, random.uniform(-0.5F, 0.5F)}));
    }
    return made;
  };
  return {.id = "E4",
          .setup = "plane x = 148376 of 12 x 12 units, 200 x 200; from 3 units before it",
          .promise = "no miss in watertight and exact",
          .scene = {mesh},
          .rays = rays,
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

// Which triangle a ray was aimed at: the first centroid for the first ray, and so on.
std::size_t intended(const Answers& answers, std::size_t step) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < answers.hits.size(); ++i) {
    count += answers.hits[i].primitive_id == i * step ? 1 : 0;
  }
  return count;
}

Row aimed_from_afar() {
  constexpr std::size_t kStep = 40;
  const double angle = 4.34, c = std::cos(angle), s = std::sin(angle), n = std::sqrt(66.0);
  const std::array<double, 3> k = {4 / n, 7 / n, -1 / n};
  Mesh mesh = tests::grid(100);
  for (Corners& corners : mesh) {
    for (Vec3f& p : corners) {  // Rodrigues
      const std::array<double, 3> v = {100.0 * p.x, 100.0 * p.y, 0};
      const double along = (k[0] * v[0] + k[1] * v[1] + k[2] * v[2]) * (1 - c);
      p = {static_cast<float>(v[0] * c + (k[1] * v[2] - k[2] * v[1]) * s + k[0] * along),
           static_cast<float>(v[1] * c + (k[2] * v[0] - k[0] * v[2]) * s + k[1] * along),
           static_cast<float>(v[2] * c + (k[0] * v[1] - k[1] * v[0]) * s + k[2] * along)};
    }
  }
  const auto rays = [mesh](auto) {
    Random random(5);
    std::vector<Ray> made;
    for (std::size_t i = 0; i < mesh.size(); i += kStep) {
      Vec3f target;
      for (int axis = 0; axis < 3; ++axis) {
        target[axis] = (mesh[i][0][axis] + mesh[i][1][axis] + mesh[i][2][axis]) / 3;
      }
      made.push_back(ray_towards(random.in_box(-1e6F, 1e6F), target));
    }
    return made;
  };
  const auto as_truth = [](const Answers& answers) {
    std::size_t same = 0;
    for (std::size_t i = 0; i < std::min(answers.hits.size(), answers.truth.size()); ++i) {
      same += answers.hits[i].primitive_id == answers.truth[i].primitive_id ? 1 : 0;
    }
    return same == answers.truth.size();
  };
  return {.id = "E5",
          .setup = "100 x 100 grid of 100 x 100 units, tilted; from up to 1e6 units away at the triangles' centroids",
          .promise = "exact gives float64's triangle; dir is rounded, so that it need not be the one aimed at",
          .scene = {mesh},
          .rays = rays,
          .tell =
              [](const Answers& answers) {
                return std::to_string(intended(answers, kStep)) + " of " + std::to_string(answers.hits.size()) +
                       " as aimed, " + tell_misses(answers);
              },
          .keeps = [as_truth](Mode mode, const Answers& answers) { return mode != Mode::exact || as_truth(answers); }};
}

Row rough_vertices() {
  Random random(6);
  const Mesh mesh = tests::rough_sphere(random, 1, 6, 16, 16);
  const auto rays = [mesh](auto) {
    Random draw(60);
    std::vector<Ray> made;
    for (int origin = 0; origin < 20; ++origin) {
      const Vec3f org = draw.in_box(-0.3F, 0.3F);
      for (const Vec3f& vertex : tests::vertices_of(mesh)) {
        made.push_back(ray_towards(org, vertex));
      }
    }
    return made;
  };
  return {.id = "E6",
          .setup = "sphere with a radius of 1 to 6 for each vertex; from inside at its vertices",
          .promise = "no miss in watertight and exact",
          .scene = {mesh},
          .rays = rays,
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

Row half_sphere() {
  Mesh dome;
  for (const Corners& corners : tests::sphere({}, 1, 16, 24)) {
    if (std::min({corners[0].z, corners[1].z, corners[2].z}) > -1e-6F) {
      dome.push_back(corners);
    }
  }
  const auto rays = [dome](auto) {
    Random random(7);
    std::vector<Ray> made;
    for (int origin = 0; origin < 12; ++origin) {
      Vec3f org = random.in_box(-0.5F, 0.5F);
      org.z = -0.1F - std::fabs(org.z);
      for (const Vec3f& vertex : tests::vertices_of(dome)) {
        if (vertex.z > 0.05F) {  // the rim is an open edge
          made.push_back(ray_towards(org, vertex));
        }
      }
    }
    return made;
  };
  return {.id = "E7",
          .setup = "half of a sphere, from below through its vertices",
          .promise = "no miss in watertight and exact",
          .scene = {dome},
          .rays = rays,
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

Row integer_grid() {
  Mesh mesh = tests::grid(32, 0.4F);
  for (Corners& corners : mesh) {
    for (Vec3f& p : corners) {
      p = {std::nearbyint(p.x * 32), std::nearbyint(p.z * 32), std::nearbyint(p.y * 32)};
    }
  }
  std::vector<Ray> rays;
  for (int x = 0; x <= 64; ++x) {
    for (int z = 0; z <= 64; ++z) {
      rays.push_back(tests::ray({float(x) / 2, 100, float(z) / 2}, {0, -1, 0}));
    }
  }
  return {.id = "E14",
          .setup =
              "height field of whole coordinates, rays along -y at all of them and between; the dragon stands in "
              "tests/bench/leaks",
          .promise = "no miss in watertight and exact",
          .scene = {mesh},
          .rays = [rays](auto) { return rays; },
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

double worst_ulps(const Answers& answers) {
  double most = 0;
  for (std::size_t i = 0; i < std::min(answers.hits.size(), answers.truth.size()); ++i) {
    const float truth = answers.truth[i].t;
    const float step = std::nextafter(truth, std::numeric_limits<float>::infinity()) - truth;
    if (std::isfinite(answers.hits[i].t) && std::isfinite(truth)) {
      most = std::max(most, std::fabs(double(answers.hits[i].t) - truth) / step);
    }
  }
  return most;
}

Row far_camera() {
  const auto rays = [](auto) {
    Random random(21);
    std::vector<Ray> made;
    for (int i = 0; i < 1000; ++i) {
      const float distance = i % 2 == 0 ? 100 : 1000;
      const float x = random.uniform(-0.9F, 0.9F), y = random.uniform(-0.4F, 0.4F);
      made.push_back(ray_towards({distance, 0.3F * distance, 0.1F * distance}, {0, x, y}));
    }
    return made;
  };
  return {.id = "E21",
          .setup = "sphere of radius 1 from 100 and 1000 units away",
          .promise = "t of exact is float64's, rounded; that of watertight at most 4 steps of float32 off",
          .scene = {tests::sphere({}, 1, 48, 96)},
          .rays = rays,
          .tell =
              [](const Answers& answers) {
                char text[64];
                std::snprintf(text, sizeof text, ", t off by up to %.0f steps", worst_ulps(answers));
                return tell_misses(answers) + text;
              },
          .keeps =
              [](Mode mode, const Answers& answers) {
                return worst_ulps(answers) <= (mode == Mode::exact ? 0 : mode == Mode::watertight ? 4 : 1e6);
              }};
}

Row spheres_in_spheres() {
  const auto rays = [](std::span<const Triangle> triangles) {
    std::vector<Triangle> inner;
    std::copy_if(triangles.begin(), triangles.end(), std::back_inserter(inner),
                 [](const Triangle& triangle) { return triangle.geometry_id == 0; });
    std::vector<Ray> made;
    for (Ray ray : rays_from_inside(22, {}, 0, 300)) {
      made.push_back(ray);
      // Between the two, as float64 says.
      ray.tnear = static_cast<float>(tests::oracle_hits(inner, ray)[0].t * (1 + 2e-5L));
      made.push_back(ray);
    }
    return made;
  };
  const auto right = [](const Answers& answers) {
    std::size_t count = 0;
    for (std::size_t i = 0; i + 1 < answers.hits.size(); i += 2) {
      count += answers.hits[i].geometry_id == 0 && answers.hits[i + 1].geometry_id == 1 ? 1 : 0;
    }
    return count;
  };
  return {.id = "E22",
          .setup = "sphere of radius 1 inside one of 1 + 4e-5: the first from inside, then on from between them",
          .promise = "the inner one, then the outer one; spheres that are no triangles wait for that feature",
          .scene = {tests::sphere({}, 1, 24, 48), tests::sphere({}, 1.0F + 4e-5F, 24, 48)},
          .rays = rays,
          .tell =
              [right](const Answers& answers) {
                return std::to_string(right(answers)) + " of " + std::to_string(answers.hits.size() / 2) + " pairs";
              },
          .keeps = [right](Mode, const Answers& answers) { return 2 * right(answers) == answers.hits.size(); }};
}

Row page_borders() {
  const Vec3f center{10, -20, 30};
  BuildConfig config = tests::small_pages();
  config.codec = "draco";
  config.positions = "lattice:12b";
  const auto rays = [center](std::span<const Triangle> triangles) {
    std::vector<Ray> made;
    for (std::size_t i = 0; i < triangles.size(); i += 3) {
      made.push_back(ray_towards(center, triangles[i].v[0]));
    }
    return made;
  };
  return {.id = "E24",
          .setup = "sphere on a lattice of 12 bits, Draco page by page; at vertices, those of page borders too",
          .promise = "no miss in watertight and exact",
          .scene = {tests::sphere(center, 5, 60, 90)},
          .config = config,
          .rays = rays,
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

Row bent_quads() {
  const auto rays = [](auto) {
    Random random(25);
    std::vector<Ray> made;
    for (int i = 0; i < 3000; ++i) {
      const Vec3f target{random.uniform(0.1F, 0.9F), random.uniform(0.1F, 0.9F), 0};
      made.push_back(ray_towards({target.x, target.y, 10}, {target.x + random.uniform(-0.05F, 0.05F), target.y, -10}));
    }
    return made;
  };
  return {.id = "E25",
          .setup = "height field of quads that are not flat, from above",
          .promise = "no miss in watertight and exact",
          .scene = {tests::grid(64, 0.4F)},
          .rays = rays,
          .tell = tell_misses,
          .keeps = all_hit_but_in_fast};
}

}  // namespace

std::vector<Row> mesh_rows() {
  return {far_sphere(),   far_plane(),  aimed_from_afar(),    rough_vertices(), half_sphere(),
          integer_grid(), far_camera(), spheres_in_spheres(), page_borders(),   bent_quads()};
}

}  // namespace raymill::extremes
