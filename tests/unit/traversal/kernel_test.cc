// Kernels against the oracle, against each other, and at the rays that break ray tracers.
#include "traversal/kernel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "tests/support/brute_force.h"
#include "tests/support/effort.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "tests/support/trees.h"

namespace raymill::tests {
namespace {

using traversal::Isa;
using traversal::runnable_isas;

constexpr float kInf = std::numeric_limits<float>::infinity();

struct Case {
  const char* name;
  std::function<Scene(Random&)> make;
};

std::vector<Case> cases() {
  return {
      {"soup",
       [](Random& random) {
         return Scene{soup(random, 700), soup(random, 300, 0.02F)};
       }},
      {"grid", [](Random&) { return Scene{grid(20, 0.2F)}; }},
      {"sphere",
       [](Random&) {
         return Scene{sphere({0.1F, 0, 0}, 1, 16, 32)};
       }},
      {"needles", [](Random& random) { return Scene{needles(random, 700)}; }},
      {"boxes", [](Random& random) { return Scene{boxes(random, 60)}; }},
      {"far_from_the_origin",
       [](Random& random) {
         return Scene{moved(soup(random, 700), {3000, -2000, 5000})};
       }},
      {"tiny", [](Random& random) { return Scene{moved(soup(random, 500), {}, 1e-12F)}; }},
      {"huge", [](Random& random) { return Scene{moved(soup(random, 500), {}, 1e12F)}; }},
  };
}

class KernelOf : public testing::TestWithParam<std::size_t> {
 protected:
  KernelOf() : random_(77 + GetParam()), scene_(cases()[GetParam()].make(random_)) {}
  Random random_;
  Scene scene_;
};

TEST_P(KernelOf, AgreesWithTheOracle) {
  const std::vector<Triangle> triangles = triangles_of(scene_);
  const Pages pages = build_pages(scene_, 8);
  const LoadedPages loaded = load_pages(pages);
  const std::vector<Ray> rays = random_rays(random_, pages.tree.bounds, 1500);
  const std::vector<Hit> hits = run_kernel(loaded, rays, {.isa = runnable_isas().front()}).hits;
  std::size_t found = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const std::string objection = oracle_objects(triangles, rays[i], hits[i]);
    EXPECT_EQ(objection, "") << text_of(rays[i]) << " gave " << text_of(hits[i]);
    found += hits[i].primitive_id != kNoId ? 1 : 0;
  }
  EXPECT_GT(found, rays.size() / 50) << "a test that hits nothing proves nothing";
  EXPECT_LT(found, rays.size()) << "nor does one that never misses";
}

// ISA, width, bitstack, residency and batch: the same bits, and for one width and residency the same work.
TEST_P(KernelOf, EveryIsaWidthAndScheduleGivesTheSameBits) {
  for (const Query query : {Query::closest, Query::any}) {
    for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
      std::vector<Hit> first;
      std::vector<Ray> rays;
      for (const unsigned width : {8u, 4u}) {
        std::map<Residency, traversal::KernelCounters> work;
        const Pages pages = build_pages(scene_, width);
        const LoadedPages loaded = load_pages(pages);
        if (rays.empty()) {
          rays = random_rays(random_, pages.tree.bounds, tests::kSanitized ? 150 : 400);
          const std::vector<Ray> hostile = hostile_rays();
          rays.insert(rays.end(), hostile.begin(), hostile.end());
        }
        for (const Isa isa : runnable_isas()) {
          for (const Residency residency : {Residency::all, Residency::one_page, Residency::random}) {
            // One ray alone, and more than have their turn at once.
            const std::size_t batch_rays = residency == Residency::all && isa == runnable_isas().back() ? 1 : 200;
            const KernelRun run{isa, query, mode, residency, 5, batch_rays};
            const KernelHits result = run_kernel(loaded, rays, run);
            EXPECT_FALSE(result.corrupt);
            const auto& same = work.try_emplace(residency, result.counters).first->second;
            EXPECT_EQ(result.counters.nodes_visited, same.nodes_visited) << to_string(isa) << int(residency);
            EXPECT_EQ(result.counters.triangles_tested, same.triangles_tested) << to_string(isa) << int(residency);
            if (first.empty()) {
              first = result.hits;
            }
            for (std::size_t i = 0; i < rays.size(); ++i) {
              ASSERT_TRUE(same_bits(first[i], result.hits[i]))
                  << text_of(rays[i]) << "\n  " << text_of(first[i]) << "\n  " << text_of(result.hits[i]) << "\n  "
                  << to_string(isa) << ", width " << width << ", " << to_string(query) << ", " << to_string(mode)
                  << ", residency " << int(residency);
            }
          }
        }
      }
    }
  }
}

TEST_P(KernelOf, AnyHitIsThereExactlyWhereAClosestHitIs) {
  const Pages pages = build_pages(scene_, 8);
  const LoadedPages loaded = load_pages(pages);
  const std::vector<Ray> rays = random_rays(random_, pages.tree.bounds, tests::kSanitized ? 500 : 2000);
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    const auto closest = run_kernel(loaded, rays, {.mode = mode}).hits;
    const auto any = run_kernel(loaded, rays, {.query = Query::any, .mode = mode}).hits;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      EXPECT_EQ(any[i].t, closest[i].primitive_id == kNoId ? kInf : 0.0F) << text_of(rays[i]);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, KernelOf, testing::Range(std::size_t{0}, cases().size()),
                         [](const auto& param) { return std::string(cases()[param.param].name); });

Hit one(const Scene& scene, const Ray& r, KernelRun run = {}) {
  const LoadedPages loaded = load_pages(build_pages(scene, 8));
  Hit first;
  for (const Isa isa : runnable_isas()) {
    run.isa = isa;
    const Hit hit = run_kernel(loaded, {&r, 1}, run).hits[0];
    if (isa != runnable_isas().front()) {
      EXPECT_TRUE(same_bits(hit, first)) << text_of(r);
    }
    first = hit;
  }
  return first;
}

const Scene kUnitTriangle{{Corners{Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}};

TEST(Kernel, BarycentricsAndNormalFollowTheCorners) {
  const Hit hit = one(kUnitTriangle, ray({0.25F, 0.5F, 2}, {0, 0, -1}));
  EXPECT_EQ(hit.t, 2);
  EXPECT_EQ(hit.u, 0.25F);
  EXPECT_EQ(hit.v, 0.5F);
  EXPECT_EQ(hit.normal, (std::array<float, 3>{0, 0, 1})) << "not flipped towards the ray";
  EXPECT_EQ(one(kUnitTriangle, ray({0.25F, 0.5F, -2}, {0, 0, 1})).normal, hit.normal);
}

// EXTREMES E1.
TEST(Kernel, RayInTheTrianglesPlaneHitsNothing) {
  EXPECT_EQ(one(kUnitTriangle, ray({-1, 0.5F, 0}, {1, 0, 0})).t, kInf);
  EXPECT_EQ(one(kUnitTriangle, ray({-1, 0, 0}, {1, 0, 0})).t, kInf) << "along an edge";
  EXPECT_EQ(one(kUnitTriangle, ray({0.2F, 0.2F, 0}, {0.3F, -0.1F, 0})).t, kInf) << "from inside";
}

// EXTREMES E2: both ends of the interval belong to it.
TEST(Kernel, OriginOnTheTriangleIsAHitAtZero) {
  for (const float z : {1.0F, -1.0F}) {
    const Hit hit = one(kUnitTriangle, ray({0.25F, 0.25F, 0}, {0, 0, z}));
    EXPECT_EQ(hit.t, 0);
    EXPECT_EQ(hit.primitive_id, 0u);
  }
  Ray r = ray({0.25F, 0.25F, 1}, {0, 0, -1});
  r.tnear = 1;
  EXPECT_EQ(one(kUnitTriangle, r).t, 1) << "tnear is inclusive";
  r.tnear = std::nextafter(1.0F, 2.0F);
  EXPECT_EQ(one(kUnitTriangle, r).t, kInf);
  r.tnear = 0;
  r.tfar = 1;
  EXPECT_EQ(one(kUnitTriangle, r).t, 1) << "tfar is inclusive";
  r.tfar = std::nextafter(1.0F, 0.0F);
  EXPECT_EQ(one(kUnitTriangle, r).t, kInf);
}

TEST(Kernel, NegativeTnearSeesBehindTheOrigin) {
  Ray r = ray({0.25F, 0.25F, -3}, {0, 0, -1});
  EXPECT_EQ(one(kUnitTriangle, r).t, kInf);
  r.tnear = -10;
  EXPECT_EQ(one(kUnitTriangle, r).t, -3);
  r.tfar = -4;
  EXPECT_EQ(one(kUnitTriangle, r).t, kInf);
}

// EXTREMES E8: embree#387 reports a hit far outside the triangle.
TEST(Kernel, GrazingRayFarAwayHitsNothing) {
  const Scene scene{{Corners{Vec3f{0, 0, 0}, {11.2F, 0, 0}, {11.0F, 1.4F, 0}}}};
  for (const float sign : {1.0F, -1.0F}) {
    const Ray r = ray({500, 300, sign * 2}, {-0.8F, 0.6F, -sign * 0.00907F});
    EXPECT_EQ(one(scene, r).t, kInf);
  }
}

// EXTREMES E15: 0 * inf in the slab test.
TEST(Kernel, OriginOnAFaceOfTheBoxWithAZeroComponentIsVisited) {
  Random random(1);
  const Scene scene{boxes(random, 1)};
  const Mesh& mesh = scene[0];
  storage::Aabb box;
  for (const Vec3f& p : vertices_of(mesh)) {
    box.grow(p);
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (const bool at_lower : {false, true}) {
      for (const float zero : {0.0F, -0.0F}) {
        const int along = (axis + 1) % 3;
        Vec3f org{0.5F * (box.lower.x + box.upper.x), 0.5F * (box.lower.y + box.upper.y),
                  0.5F * (box.lower.z + box.upper.z)};
        org[axis] = at_lower ? box.lower[axis] : box.upper[axis];
        org[along] = box.lower[along] - 1;
        Vec3f dir{zero, zero, zero};
        dir[along] = 1;
        const Hit hit = one(scene, ray(org, dir));
        EXPECT_EQ(hit.t, box.lower[along] - org[along]) << "axis " << axis << ": the edge of the near face";
      }
    }
  }
}

// The boxes beside an axis-parallel ray exit at -inf, which the pad makes NaN; they were all entered.
TEST(Kernel, AxisParallelRaysEnterNoMoreBoxesThanTiltedOnes) {
  Random random(9);
  const LoadedPages loaded = load_pages(build_pages({soup(random, 4000, 0.05F)}, 8));
  std::vector<Ray> straight, tilted;
  for (int i = 0; i < 200; ++i) {
    const Vec3f org{random.uniform(-1, 1), random.uniform(-1, 1), 2};
    for (const float sign : {0.0F, -0.0F}) {
      straight.push_back(ray(org, {sign, sign, -1}));
      tilted.push_back(ray(org, {1e-4F, -1e-4F, -1}));
    }
  }
  for (const Isa isa : runnable_isas()) {
    for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
      const KernelRun run{.isa = isa, .mode = mode};
      const auto few = run_kernel(loaded, tilted, run).counters.nodes_visited;
      EXPECT_LE(run_kernel(loaded, straight, run).counters.nodes_visited, few + few / 20) << to_string(isa);
    }
  }
}

// EXTREMES E17.
TEST(Kernel, ZerosOfBothSignsInTheDirectionGiveTheSameHits) {
  Random random(2);
  const Scene scene{sphere({}, 1, 12, 24)};
  const LoadedPages loaded = load_pages(build_pages(scene, 8));
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        if (x == 0 && y == 0 && z == 0) {
          continue;
        }
        std::vector<Ray> rays;
        for (unsigned signs = 0; signs < 8; ++signs) {
          const auto component = [&](int value, unsigned bit) {
            return value == 0 && (signs >> bit & 1) != 0 ? -0.0F : float(value);
          };
          rays.push_back(ray({0.01F, 0.02F, -0.03F}, {component(x, 0), component(y, 1), component(z, 2)}));
        }
        const auto hits = run_kernel(loaded, rays, {}).hits;
        EXPECT_NE(hits[0].primitive_id, kNoId) << "from inside a closed mesh";
        for (const Hit& hit : hits) {
          EXPECT_TRUE(same_bits(hit, hits[0])) << x << " " << y << " " << z;
        }
      }
    }
  }
}

// EXTREMES E18.
TEST(Kernel, InvalidRaysAnswerNaNAndValidOnesNeverDo) {
  const LoadedPages loaded = load_pages(build_pages(kUnitTriangle, 8));
  for (const Ray& r : hostile_rays()) {
    bool valid = r.tnear <= r.tfar && r.dir != std::array<float, 3>{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      valid = valid && std::isfinite(r.org[axis]) && std::isfinite(r.dir[axis]);
    }
    for (const Isa isa : runnable_isas()) {
      const Hit hit = run_kernel(loaded, {&r, 1}, {.isa = isa}).hits[0];
      EXPECT_EQ(std::isnan(hit.t), !valid) << text_of(r);
      EXPECT_FALSE(valid && hit.primitive_id != kNoId && !std::isfinite(hit.t)) << text_of(r);
    }
  }
}

// EXTREMES E20.
TEST(Kernel, TCountsInLengthsOfTheDirection) {
  Random random(3);
  const Scene scene{soup(random, 300)};
  const LoadedPages loaded = load_pages(build_pages(scene, 8));
  const storage::Aabb box{{-1, -1, -1}, {1, 1, 1}};
  for (const Ray& unit : random_rays(random, box, 200)) {
    Ray base = unit;
    base.tnear = 0;
    base.tfar = kInf;
    const Hit expected = run_kernel(loaded, {&base, 1}, {}).hits[0];
    for (const int exponent : {-66, -30, -3, 5, 40, 66}) {
      Ray scaled = base;
      for (float& component : scaled.dir) {
        component = std::ldexp(component, exponent);
      }
      const Hit hit = run_kernel(loaded, {&scaled, 1}, {}).hits[0];
      ASSERT_EQ(hit.primitive_id, expected.primitive_id) << text_of(scaled);
      if (hit.primitive_id != kNoId) {
        EXPECT_EQ(std::ldexp(hit.t, exponent), expected.t) << "a power of two changes no bit";
      }
    }
  }
}

TEST(Kernel, HitBeyondFloat32IsAMiss) {
  const Scene scene{moved(kUnitTriangle[0], {0, 0, 0}, 1e20F)};
  const Hit hit = one(scene, ray({1e19F, 1e19F, -1e20F}, {0, 0, 1e-25F}));
  EXPECT_EQ(hit.t, kInf);
  EXPECT_EQ(hit.primitive_id, kNoId);
}

}  // namespace
}  // namespace raymill::tests
