// Single triangles, planes and boxes.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "tests/extremes/row.h"

namespace raymill::extremes {
namespace {

using tests::ray;

constexpr float kEndless = std::numeric_limits<float>::infinity();
constexpr float kLeast = std::numeric_limits<float>::denorm_min();

Scene unit_triangle() { return {{Corners{Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}}; }

Ray within(Ray r, float tnear, float tfar) {
  r.tnear = tnear;
  r.tfar = tfar;
  return r;
}

std::function<std::vector<Ray>(std::span<const Triangle>)> these(std::vector<Ray> rays) {
  return [rays](std::span<const Triangle>) { return rays; };
}

Row in_the_plane() {
  return {.id = "E1",
          .setup = "rays in a triangle's plane: across it, along an edge, from inside",
          .promise = "no hit, no NaN",
          .scene = unit_triangle(),
          .rays = these({ray({-1, 0.5F, 0}, {1, 0, 0}), ray({2, 0.5F, 0}, {-1, 0, 0}), ray({-1, 0, 0}, {1, 0, 0}),
                         ray({0.2F, 0.2F, 0}, {0.3F, -0.1F, 0})}),
          .tell = tell_distances,
          .keeps = always(tell_distances, "miss, miss, miss, miss")};
}

Row origin_on_it() {
  const Ray up = ray({0.25F, 0.25F, 0}, {0, 0, 1}), down = ray({0.25F, 0.25F, 0}, {0, 0, -1});
  const Ray above = ray({0.25F, 0.25F, 1}, {0, 0, -1});
  return {.id = "E2",
          .setup = "origin on the triangle, and intervals that end at the hit",
          .promise = "both ends belong to the interval",
          .scene = unit_triangle(),
          .rays = these({up, down, within(up, kLeast, kEndless), within(down, kLeast, kEndless),
                         within(above, 1, kEndless), within(above, std::nextafter(1.0F, 2.0F), kEndless),
                         within(above, 0, 1), within(above, 0, std::nextafter(1.0F, 0.0F))}),
          .tell = tell_distances,
          .keeps = always(tell_distances, "0, 0, miss, miss, 1, miss, 1, miss")};
}

// The numbers are not public in full; this has its angle, edges and distances.
Row grazing() {
  return {.id = "E8",
          .setup = "ray 0.52 degrees to the plane of a skinny triangle (11.2 x 1.4), 600 units away",
          .promise = "no hit",
          .scene = {{Corners{Vec3f{0, 0, 0}, {11.2F, 0, 0}, {11.0F, 1.4F, 0}}}},
          .rays = these({ray({500, 300, 2}, {-0.8F, 0.6F, -0.00907F}), ray({500, 300, -2}, {-0.8F, 0.6F, 0.00907F}),
                         ray({-500, 300, 2}, {0.8F, 0.6F, -0.00907F})}),
          .tell = tell_hits,
          .keeps = none_hits};
}

// Segments in a triangle's plane but for a little, on a line that passes it by a tenth at least.
std::vector<Ray> segments_beside(const Corners& c, std::size_t count) {
  Random random(9);
  Vec3f center, u, v;
  for (int axis = 0; axis < 3; ++axis) {
    center[axis] = (c[0][axis] + c[1][axis] + c[2][axis]) / 3;
    u[axis] = c[1][axis] - c[0][axis];
    v[axis] = c[2][axis] - c[0][axis];
  }
  const Vec3f normal{u.y * v.z - u.z * v.y, u.z * v.x - u.x * v.z, u.x * v.y - u.y * v.x};
  const Vec3f across{normal.y * u.z - normal.z * u.y, normal.z * u.x - normal.x * u.z, normal.x * u.y - normal.y * u.x};
  const auto length = [](const Vec3f& p) { return std::sqrt(p.x * p.x + p.y * p.y + p.z * p.z); };
  const float radius = length(u) + length(v), unit = radius / length(across), lift = 1e-4F / length(normal);
  std::vector<Ray> rays;
  while (rays.size() < count) {
    const float away = random.uniform(1.1F, 2) * unit, from = random.uniform(-3, 3), to = random.uniform(-3, 3);
    const float low = random.uniform(-lift, lift), high = random.uniform(-lift, lift);
    Vec3f a, b;
    for (int axis = 0; axis < 3; ++axis) {
      a[axis] = center[axis] + away * across[axis] + from * u[axis] + low * normal[axis];
      b[axis] = center[axis] + away * across[axis] + to * u[axis] + high * normal[axis];
    }
    rays.push_back(within(tests::ray_towards(a, b), 0, 1));
  }
  return rays;
}

Row segments() {
  const Corners triangle{Vec3f{0x1.d45826p-3F, 0x1.5a499cp+0F, 0.3F}, {0.31F, 1.29F, 0.37F}, {0.27F, 1.41F, 0.41F}};
  return {.id = "E9",
          .setup = "2000 segments nearly in a triangle's plane that pass it at a distance",
          .promise = "no hit, the same on every ISA",
          .scene = {{triangle}},
          .rays = these(segments_beside(triangle, 2000)),
          .tell = tell_hits,
          .keeps = none_hits};
}

// A height field of millimetres, 5e6 units out, in float32. What is asked for is the height before rounding.
constexpr float kFar = 5e6F;
double millimetres(int i, int j) { return 1e-3 * ((7 * i + 3 * j) % 5); }

Row far_features() {
  constexpr int kCells = 40;
  const auto point = [](int i, int j) {
    return Vec3f{kFar + 16 * float(i), kFar + 16 * float(j), static_cast<float>(kFar + millimetres(i, j))};
  };
  Mesh mesh;
  std::vector<Ray> rays;
  for (int i = 0; i < kCells; ++i) {
    for (int j = 0; j < kCells; ++j) {
      mesh.push_back({point(i, j), point(i + 1, j), point(i + 1, j + 1)});
      mesh.push_back({point(i, j), point(i + 1, j + 1), point(i, j + 1)});
      rays.push_back(ray({point(i, j).x, point(i, j).y, kFar + 16}, {0, 0, -1}));
    }
  }
  const auto worst = [](const Answers& answers) {
    double most = 0;
    for (std::size_t i = 0; i < answers.hits.size(); ++i) {
      const int column = static_cast<int>(i) / kCells, row = static_cast<int>(i) % kCells;
      most = std::max(most, std::fabs(answers.hits[i].t - (16 - millimetres(column, row))));
    }
    return most;
  };
  return {.id = "E10",
          .setup = "heights of millimetres 5e6 units from the origin, in float32",
          .promise =
              "off by half a step of float32, 0.25, at most: millimetres are lost; [offset.md](offset.md) keeps them",
          .scene = {mesh},
          .rays = these(rays),
          .tell =
              [worst](const Answers& answers) {
                char text[64];
                std::snprintf(text, sizeof text, "t off by up to %.3g", worst(answers));
                return std::string(text);
              },
          .keeps = [worst](Mode, const Answers& answers) { return worst(answers) <= 0.25; }};
}

Row separations() {
  Mesh mesh;
  std::vector<Ray> rays;
  std::vector<float> expected;
  for (float s = 1; s <= 1e5F; s *= 10) {
    mesh.push_back({Vec3f{4 * s, 0, s}, {5 * s, 0, s}, {4 * s, s, s}});
    for (int e = 0; e <= 9; ++e) {
      const auto z = static_cast<float>(s + s * std::pow(10.0, -e));
      rays.push_back(ray({4.3F * s, 0.3F * s, z}, {0, 0, -1}));
      expected.push_back(z - s);
    }
  }
  const auto right = [expected](const Answers& answers) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < answers.hits.size(); ++i) {
      count += answers.hits[i].t == expected[i] ? 1 : 0;
    }
    return count;
  };
  return {
      .id = "E11",
      .setup = "triangles of size 1 to 1e5, origins off them by the size times 1 to 1e-9, rounded to float32",
      .promise = "hit at the exact t, which is 0 where the origin rounds onto the triangle, in watertight and exact",
      .scene = {mesh},
      .rays = these(rays),
      .tell =
          [right](const Answers& answers) {
            return std::to_string(right(answers)) + " of " + std::to_string(answers.hits.size()) + " exact";
          },
      .keeps = [right](Mode mode,
                       const Answers& answers) { return mode == Mode::fast || right(answers) == answers.hits.size(); }};
}

// The faces of the box [0, 1]^3, each cut into cells x cells squares of two triangles.
Mesh unit_box(int cells) {
  Mesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {0.0F, 1.0F}) {
      const auto point = [&](int i, int j) {
        Vec3f p;
        p[axis] = side;
        p[(axis + 1) % 3] = float(i) / float(cells);
        p[(axis + 2) % 3] = float(j) / float(cells);
        return p;
      };
      for (int i = 0; i < cells; ++i) {
        for (int j = 0; j < cells; ++j) {
          mesh.push_back({point(i, j), point(i + 1, j), point(i + 1, j + 1)});
          mesh.push_back({point(i, j), point(i + 1, j + 1), point(i, j + 1)});
        }
      }
    }
  }
  return mesh;
}

Row through_boxes() {
  Mesh mesh;
  std::vector<Ray> rays;
  const float scales[] = {1e-4F, 0.1F, 1, 10, 1e4F, 1e8F};
  for (const float s : scales) {
    const Mesh box = tests::moved(unit_box(4), {4 * s, 0, 0}, s);
    mesh.insert(mesh.end(), box.begin(), box.end());
    const Ray down = ray({4.3F * s, 0.4F * s, s}, {0, 0, -1});
    rays.push_back(down);
    rays.push_back(within(down, kLeast, kEndless));
    rays.push_back(within(down, std::nextafter(s, kEndless), kEndless));
  }
  const auto right = [](const Answers& answers) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < answers.hits.size() / 3; ++i) {
      const float size = answers.rays[3 * i].org[2];
      count += answers.hits[3 * i].t == 0 && answers.hits[3 * i + 1].t == size && std::isinf(answers.hits[3 * i + 2].t);
    }
    return count;
  };
  return {.id = "E12",
          .setup = "boxes of size 1e-4 to 1e8, from exactly on the top face down through them",
          .promise = "two faces: t = 0, then the size, then nothing",
          .scene = {mesh},
          .rays = these(rays),
          .tell = [right](const Answers& answers) { return std::to_string(right(answers)) + " of 6 boxes"; },
          .keeps = [right](Mode, const Answers& answers) { return right(answers) == 6; }};
}

Row scaled_vertex() {
  return {.id = "E13",
          .setup = "a ray through a vertex of a mesh scaled by 1/64",
          .promise = "hit at 19",
          .scene = {{Corners{Vec3f{1, 0.375F, 20}, {2, 0, 20}, {2, 1, 20}},
                     Corners{Vec3f{1, 0.375F, 20}, {2, 1, 20}, {0, 1, 20}}}},
          .rays = these({ray({1, 0.375F, 1}, {0, 0, 1})}),
          .tell = tell_distances,
          .keeps = always(tell_distances, "19")};
}

Row in_a_face() {
  const Mesh box = tests::moved(unit_box(1), {}, 32);
  std::vector<Ray> rays;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float side : {0.0F, 32.0F}) {
      for (const float zero : {0.0F, -0.0F}) {
        Ray r = ray({10, 10, 10}, {zero, zero, zero});
        r.org[axis] = side;
        r.org[(axis + 1) % 3] = -1;
        r.dir[(axis + 1) % 3] = 1;
        rays.push_back(r);
      }
    }
  }
  return {.id = "E15",
          .setup = "origins on a slab's plane, dir zero across it: rays in the faces of a box of size 32",
          .promise = "the near face's edge is hit at 1, never NaN",
          .scene = {box},
          .rays = these(rays),
          .tell =
              [](const Answers& answers) {
                const auto hits =
                    std::count_if(answers.hits.begin(), answers.hits.end(), [](const Hit& hit) { return hit.t == 1; });
                return std::to_string(hits) + " of " + std::to_string(answers.hits.size()) + " at 1";
              },
          .keeps =
              [](Mode mode, const Answers& answers) {
                return std::all_of(answers.hits.begin(), answers.hits.end(), [mode](const Hit& hit) {
                  return hit.t == 1 || (mode == Mode::fast && !std::isnan(hit.t));
                });
              }};
}

Row along_edges() {
  const Mesh box = unit_box(1);
  std::vector<Ray> rays;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float sign : {1.0F, -1.0F}) {
      for (unsigned corner = 0; corner < 4; ++corner) {
        Ray r = ray({}, {});
        r.org[axis] = sign > 0 ? -1.0F : 2.0F;
        r.org[(axis + 1) % 3] = float(corner & 1);
        r.org[(axis + 2) % 3] = float(corner >> 1);
        r.dir[axis] = sign;
        rays.push_back(r);
      }
    }
  }
  return {.id = "E16",
          .setup = "axis-parallel rays along the edges of a box, both ways",
          .promise = "the corner is hit",
          .scene = {box},
          .rays = these(rays),
          .tell = tell_hits,
          .keeps = all_hit_but_in_fast};
}

}  // namespace

std::vector<Row> flat_rows() {
  return {in_the_plane(), origin_on_it(),  grazing(),       segments(),  far_features(),
          separations(),  through_boxes(), scaled_vertex(), in_a_face(), along_edges()};
}

}  // namespace raymill::extremes
