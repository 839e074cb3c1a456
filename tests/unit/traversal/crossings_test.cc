// Crossings of surfaces (traversal/crossings.md): where a ray meets an edge or a corner it crosses one of the triangles
// there, so a closed surface is crossed an even number of times by a line, and once more by a ray from inside.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <vector>

#include "tests/support/brute_force.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "tests/support/trees.h"
#include "traversal/crossing.h"

namespace raymill::tests {
namespace {

using traversal::runnable_isas;

constexpr Mode kCrossingModes[] = {Mode::watertight, Mode::exact};

// Closed: a box of 12 triangles.
Mesh box_between(const Vec3f& low, const Vec3f& high) {
  Random random(0);
  Mesh box = boxes(random, 1);
  storage::Aabb bounds;
  for (const Vec3f& p : vertices_of(box)) {
    bounds.grow(p);
  }
  for (Corners& c : box) {
    for (Vec3f& p : c) {
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = p[axis] == bounds.lower[axis] ? low[axis] : high[axis];
      }
    }
  }
  return box;
}

// Rays from `org` at each corner, at the middles of edges and at points of them, of every triangle.
std::vector<Ray> rays_at_edges(const Mesh& mesh, const Vec3f& org, Random& random) {
  std::vector<Ray> rays;
  for (const Corners& c : mesh) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3f &a = c[k], &b = c[(k + 1) % 3];
      for (const float s : {0.0F, 0.5F, random.uniform(0, 1)}) {
        rays.push_back(ray_towards(org, {a.x + (b.x - a.x) * s, a.y + (b.y - a.y) * s, a.z + (b.z - a.z) * s}));
      }
    }
  }
  return rays;
}

// Every ray crosses the surface an odd number of times, or every ray an even number.
void expect_parity(const Scene& scene, const std::vector<Ray>& rays, unsigned parity, const std::string& what) {
  for (const unsigned width : {4u, 8u}) {
    const LoadedPages pages = load_pages(build_pages(scene, width));
    for (const Mode mode : kCrossingModes) {
      for (const auto isa : runnable_isas()) {
        const auto hits =
            run_kernel(pages, rays, {.isa = isa, .query = Query::count, .mode = mode, .batch_rays = 64}).hits;
        std::size_t wrong = 0;
        for (std::size_t i = 0; i < rays.size(); ++i) {
          if (hits[i].count % 2 != parity && ++wrong <= 3) {
            ADD_FAILURE() << what << ": " << hits[i].count << " crossings of " << text_of(rays[i]);
          }
        }
        EXPECT_EQ(wrong, 0u) << what << ", of " << rays.size() << " rays, " << to_string(mode) << ", "
                             << to_string(isa);
      }
    }
  }
}

TEST(Crossings, OfAClosedSurfaceAreOddFromInsideAndEvenFromOutside) {
  Random random(1);
  const Vec3f inside{1.1F, 1.9F, 3.05F};
  const Mesh ball = sphere({1, 2, 3}, 2, 9, 14), rough = moved(rough_sphere(random, 1, 6, 9, 14), {1, 2, 3}),
             box = box_between({0.5F, 1, 2}, {2.5F, 3, 7});
  for (const Mesh& mesh : {ball, rough, box}) {
    expect_parity({mesh}, rays_at_edges(mesh, inside, random), 1, "from inside");
    for (const Vec3f& outside : {Vec3f{-20, 1, 3}, {9, 12, -11}}) {
      expect_parity({mesh}, rays_at_edges(mesh, outside, random), 0, "from outside");
    }
  }
}

// Integer coordinates and rays along the axes: every edge function that can be zero is, and silhouettes are grazed.
TEST(Crossings, OfIntegerBoxesAlongTheAxesAreEven) {
  Mesh mesh = box_between({0, 0, 0}, {4, 4, 4});
  for (const Corners& c : box_between({2, 2, 4}, {6, 6, 8})) {
    mesh.push_back(c);
  }
  std::vector<Ray> rays;
  for (int a = -1; a <= 17; ++a) {
    for (int b = -1; b <= 17; ++b) {
      const float x = 0.5F * float(a), y = 0.5F * float(b);
      rays.push_back(ray({x, y, -3}, {0, 0, 1}));
      rays.push_back(ray({x, y, 20}, {0, -0.0F, -2}));
      rays.push_back(ray({-3, x, y}, {1, 0, 0}));
      rays.push_back(ray({x, -3, y}, {0, 1, 0}));
      rays.push_back(ray({x - 10, y - 10, -10}, {1, 1, 1}));
      rays.push_back(ray({x - 10, y, -10}, {1, 0, 1}));
    }
  }
  expect_parity({mesh}, rays, 0, "boxes that share a part of a face");
  // Here float64 is exact: the rule of both modes is the same one.
  const LoadedPages pages = load_pages(build_pages({mesh}, 8));
  const auto watertight = run_kernel(pages, rays, {.query = Query::all, .mode = Mode::watertight}).crossings;
  const auto exact = run_kernel(pages, rays, {.query = Query::all, .mode = Mode::exact}).crossings;
  ASSERT_EQ(watertight.size(), exact.size());
  for (std::size_t i = 0; i < exact.size(); ++i) {
    EXPECT_EQ(watertight[i].number, exact[i].number);
    EXPECT_EQ(watertight[i].hit.primitive_id, exact[i].hit.primitive_id) << text_of(rays[exact[i].number]);
  }
}

// A fan seen along its axis: the corner that all share is crossed once, whichever way each triangle winds.
TEST(Crossings, OfACornerOfManyTrianglesIsOne) {
  for (const int count : {3, 4, 7, 32}) {
    for (const unsigned flipped : {0u, 1u, 2u}) {
      Mesh fan;
      for (int i = 0; i < count; ++i) {
        const double step = 6.283185307179586 / count;
        const auto at = [&](int k) {
          return Vec3f{float(std::cos(step * (k % count))), float(std::sin(step * (k % count))), 0.25F};
        };
        Corners c{Vec3f{0, 0, 0}, at(i), at(i + 1)};
        if (flipped > 0 && i % static_cast<int>(flipped) == 0) {
          std::swap(c[1], c[2]);
        }
        fan.push_back(c);
      }
      const LoadedPages pages = load_pages(build_pages({fan}, 8));
      for (const Mode mode : kCrossingModes) {
        for (const float z : {-1.0F, 1.0F}) {
          const Ray along = ray({0, 0, -3 * z}, {0, 0, z});
          EXPECT_EQ(run_kernel(pages, {&along, 1}, {.query = Query::count, .mode = mode}).hits[0].count, 1u)
              << count << " triangles, " << to_string(mode);
        }
      }
    }
  }
}

double full_double(Random& random, double low, double high) {
  return low + (high - low) * (double(random.next() >> 11) * 0x1p-53);
}

// Fans in the plane, with the origin on sides of theirs but for a rounding and two sides that all but coincide:
// products round to the same number where their exact difference is not zero.
TEST(Crossings, OfSidesTooNearForFloat64AreOfOneTriangle) {
  Random random(3);
  std::size_t ties = 0;
  for (int round = 0; round < 3000; ++round) {
    std::vector<std::array<double, 2>> rim;
    for (int i = 0; i < 5; ++i) {
      const double angle = 1.2566370614359172 * i + full_double(random, 0, 1), r = full_double(random, 1, 2);
      rim.push_back({r * std::cos(angle), r * std::sin(angle)});
    }
    // A second corner in the same direction, as far as float64 can say, and the hub on the other side of the origin.
    const double near = full_double(random, 0.5, 1), back = full_double(random, 0.001, 0.1);
    rim.insert(rim.begin() + 1, {rim[0][0] * near, rim[0][1] * near});
    const std::array<double, 2> hub{-rim[0][0] * back, -rim[0][1] * back};
    ties += hub[0] * rim[0][1] == hub[1] * rim[0][0] ? 1 : 0;
    int owners = 0;
    for (std::size_t i = 0; i < rim.size(); ++i) {
      const auto &p = rim[i], &q = rim[(i + 1) % rim.size()];
      traversal::EdgeFunctions edges{};
      owners += traversal::owns_crossing({{hub[0], p[0], q[0]}, {hub[1], p[1], q[1]}}, edges) ? 1 : 0;
    }
    EXPECT_EQ(owners % 2, 1) << "round " << round;
  }
  EXPECT_GT(ties, 300u);
}

// The oracle says which crossings there are where it is sure; the list has each once, and no others.
TEST(Crossings, AreThoseOfTheOracleEachOnceInEveryMode) {
  Random random(4);
  const Scene scene = {soup(random, 400, 0.5F), moved(sphere({}, 1, 12, 16), {}), grid(8, 0.3F)};
  const std::vector<Triangle> triangles = triangles_of(scene);
  const std::vector<Ray> rays = random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 400);
  const LoadedPages pages = load_pages(build_pages(scene, 8));
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    for (const Residency residency : {Residency::all, Residency::one_page, Residency::random}) {
      const KernelRun run{.query = Query::all, .mode = mode, .residency = residency, .batch_rays = 32};
      KernelHits found = run_kernel(pages, rays, run);
      const auto by_ray = [](const traversal::Crossing& a, const traversal::Crossing& b) {
        return std::tie(a.number, a.hit.geometry_id, a.hit.primitive_id) <
               std::tie(b.number, b.hit.geometry_id, b.hit.primitive_id);
      };
      std::sort(found.crossings.begin(), found.crossings.end(), by_ray);
      EXPECT_EQ(std::adjacent_find(found.crossings.begin(), found.crossings.end(),
                                   [&](const auto& a, const auto& b) { return !by_ray(a, b); }),
                found.crossings.end())
          << "no triangle twice";
      std::size_t sure = 0;
      for (std::uint32_t i = 0; i < rays.size(); ++i) {
        std::size_t confirmed = 0;
        for (const OracleHit& hit : oracle_hits(triangles, rays[i])) {
          const traversal::Crossing wanted{
              i, {.primitive_id = hit.triangle->primitive_id, .geometry_id = hit.triangle->geometry_id}};
          const auto at = std::lower_bound(found.crossings.begin(), found.crossings.end(), wanted, by_ray);
          const bool there = at != found.crossings.end() && !by_ray(wanted, *at);
          EXPECT_TRUE(there || !hit.certain) << to_string(mode) << ": " << text_of(rays[i]);
          confirmed += there ? 1 : 0;
          sure += hit.certain ? 1 : 0;
          if (there && mode != Mode::fast) {
            EXPECT_NEAR(at->hit.t, double(hit.t), 1e-5 * std::fabs(double(hit.t)) + 1e-6);
          }
        }
        EXPECT_EQ(confirmed, found.hits[i].count) << "none that the oracle does not know; " << text_of(rays[i]);
      }
      EXPECT_GT(sure, 2 * rays.size());
    }
  }
}

}  // namespace
}  // namespace raymill::tests
