// Mode exact: what it promises beyond the others, and the arithmetic that it stands on.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/exact/comparison.h"
#include "tests/exact/rational_oracle.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "traversal/expansion.h"

namespace raymill::tests {
namespace {

using traversal::runnable_isas;

class ExactAgainst : public testing::TestWithParam<std::size_t> {};

TEST_P(ExactAgainst, TheRationalOracleDiffersNowhere) {
  Random random(100 + GetParam());
  std::uint64_t hits = 0;
  for (int scene = 0; scene < 3; ++scene) {
    const Compared compared = compare_adversary(random, Adversary(GetParam()), 200);
    EXPECT_EQ(compared.differences, 0u) << compared.first;
    hits += compared.hits;
  }
  EXPECT_GT(hits, 100u) << "a test that hits nothing proves nothing";
}

INSTANTIATE_TEST_SUITE_P(Adversaries, ExactAgainst, testing::Range(std::size_t{0}, kAdversaries.size()),
                         [](const auto& param) { return std::string(kAdversaries[param.param]); });

Hit one_exact(const Scene& scene, const Ray& r, Query query = Query::closest) {
  const LoadedPages loaded = load_pages(build_pages(scene, 8));
  return run_kernel(loaded, {&r, 1}, {.isa = runnable_isas().front(), .query = query, .mode = Mode::exact}).hits[0];
}

// A plane at z = 0 in which one corner of the triangle is lifted, so that the ray meets it at t = 1 +- 2^-26.
Mesh tilted(float lift) { return {Corners{Vec3f{-1, -1, 0}, {1, -1, 0}, {0, 3, lift}}}; }

TEST(Exact, TheNearerOfTwoHitsThatRoundToTheSameTWins) {
  const Ray down = ray({0, 0, 1}, {0, 0, -1});
  const float lift = 0x1p-24F;
  const Scene nearer_last{tilted(0), tilted(lift)}, nearer_first{tilted(lift), tilted(0)};
  EXPECT_EQ(one_exact(nearer_last, down).t, 1);
  EXPECT_EQ(one_exact(nearer_last, down).geometry_id, 1u) << "whatever the ids say";
  EXPECT_EQ(one_exact(nearer_first, down).geometry_id, 0u);
  EXPECT_EQ(one_exact({tilted(lift), tilted(lift)}, down).geometry_id, 0u) << "at the same t the ids decide";
}

// Two stores of the same triangles in pages of their own: the record carries what decides.
TEST(Exact, ATieIsDecidedWhenThePageOfTheFirstHitIsGone) {
  Scene scene;
  for (int i = 0; i < 3000; ++i) {
    scene.push_back(tilted(std::ldexp(float(i * 7 % 3000), -38)));  // below 2^-26
  }
  const LoadedPages loaded = load_pages(build_pages(scene, 8));
  ASSERT_GT(loaded.images.size(), 1u);
  const Ray down = ray({0, 0, 1}, {0, 0, -1});
  const std::uint32_t highest = 857;  // 857 * 7 % 3000 = 2999
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const KernelRun run{.mode = Mode::exact, .residency = Residency::random, .seed = seed};
    EXPECT_EQ(run_kernel(loaded, {&down, 1}, run).hits[0].geometry_id, highest);
  }
}

TEST(Exact, TheIntervalsEndsAreComparedBeforeRounding) {
  Ray down = ray({0, 0, 1}, {0, 0, -1});
  const float lift = 0x1p-24F;  // t = 1 - 2^-26, which rounds to 1
  down.tnear = 1;
  EXPECT_EQ(one_exact({tilted(lift)}, down).primitive_id, kNoId);
  EXPECT_EQ(one_exact({tilted(-lift)}, down).t, 1);
  down.tnear = 0;
  down.tfar = 1;
  EXPECT_EQ(one_exact({tilted(lift)}, down).t, 1);
  EXPECT_EQ(one_exact({tilted(-lift)}, down).primitive_id, kNoId) << "1 + 2^-26 is beyond";
  EXPECT_EQ(one_exact({tilted(-lift)}, down, Query::any).t, std::numeric_limits<float>::infinity());
}

TEST(Exact, TBetweenTwoFloatsGoesToTheEvenOne) {
  const Ray down = ray({0, 0, 1}, {0, 0, -1});
  EXPECT_EQ(one_exact({tilted(-0x1p-22F)}, down).t, 1) << "1 + 2^-24";
  EXPECT_EQ(one_exact({tilted(-3 * 0x1p-22F)}, down).t, 1 + 0x1p-22F) << "1 + 3 2^-24";
  const Scene flat{tilted(0)};
  EXPECT_EQ(one_exact(flat, ray({0, 0, 3 * 0x1p-149F}, {0, 0, -2})).t, 0x1p-148F) << "one and a half denormals";
  const Hit zero = one_exact(flat, ray({0, 0, 0x1p-149F}, {0, 0, -2}));
  EXPECT_EQ(zero.t, 0) << "half of one";
  EXPECT_EQ(zero.primitive_id, 0u);
}

// EXTREMES E1, E19: in the plane, and triangles without area.
TEST(Exact, RaysInThePlaneAndTrianglesWithoutAreaGiveNoHit) {
  const Scene flat{{Corners{Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}};
  EXPECT_EQ(one_exact(flat, ray({-1, 0.5F, 0}, {1, 0, 0})).primitive_id, kNoId);
  EXPECT_EQ(one_exact(flat, ray({-1, 0, 0}, {1, 0, 0})).primitive_id, kNoId) << "along an edge";
  EXPECT_EQ(one_exact(flat, ray({-1, 0.5F, 0}, {1, 0, 0x1p-140F})).primitive_id, kNoId)
      << "parallel but for a denormal";
  EXPECT_EQ(one_exact(flat, ray({0.25F, 0.5F, -0x1p-149F}, {0, 0, 0x1p-149F})).t, 1);
  const Scene line{{Corners{Vec3f{0, 0, 0}, {1, 1, 0}, {2, 2, 0}}}};
  EXPECT_EQ(one_exact(line, ray({1, 1, 1}, {0, 0, -1})).primitive_id, kNoId);
}

// Every edge and vertex of a closed mesh, from inside, far from the origin.
TEST(Exact, NoRayLeavesAClosedMesh) {
  Random random(5);
  for (const Vec3f center : {Vec3f{0, 0, 0}, {148376, 1234, -223423}}) {
    const Mesh mesh = sphere(center, 2, 12, 20);
    const LoadedPages loaded = load_pages(build_pages({mesh}, 8));
    std::vector<Ray> rays;
    for (const Corners& c : mesh) {
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3f &a = c[k], &b = c[(k + 1) % 3];
        rays.push_back(ray_towards(center, a));
        rays.push_back(ray_towards(center, {0.5F * (a.x + b.x), 0.5F * (a.y + b.y), 0.5F * (a.z + b.z)}));
        rays.push_back(ray(center, random.direction()));
      }
    }
    for (const auto isa : runnable_isas()) {
      const auto hits = run_kernel(loaded, rays, {.isa = isa, .mode = Mode::exact}).hits;
      for (std::size_t i = 0; i < rays.size(); ++i) {
        EXPECT_NE(hits[i].primitive_id, kNoId) << text_of(rays[i]);
      }
    }
  }
}

// The products of an edge function that the line passes within a rounding: one overflowed, the other did not, and the
// float32 filter took the infinity for its sign.
TEST(Exact, AnEdgeFunctionThatOverflowsOnOneSideRejectsNothing) {
  const Scene scene{{Corners{Vec3f{0x1.2f57c8p+63F, 0x1.bb2baap+62F, 0},
                             {0x1.9dba6ap+64F, -0x1.75edp+56F, 0},
                             {-0x1.531334p+63F, 0x1.e1ee94p+64F, 0}}}};
  const Ray down = ray({0x1.8ec43p+63F, 0x1.605d1ep+63F, 0x1.9e6a2p+63F}, {0, 0, -1});
  const LoadedPages loaded = load_pages(build_pages(scene, 8));
  for (const Mode mode : {Mode::exact, Mode::watertight}) {
    for (const auto isa : runnable_isas()) {
      EXPECT_EQ(run_kernel(loaded, {&down, 1}, {.isa = isa, .mode = mode}).hits[0].t, down.org[2]) << to_string(mode);
    }
  }
}

// EXTREMES E13.
TEST(Exact, VertexOfAScaledMeshIsHitAtItsT) {
  const Scene scene{
      {Corners{Vec3f{1, 0.375F, 20}, {2, 0, 20}, {2, 1, 20}}, Corners{Vec3f{1, 0.375F, 20}, {2, 1, 20}, {0, 1, 20}}}};
  const Hit hit = one_exact(scene, ray({1, 0.375F, 1}, {0, 0, 1}));
  EXPECT_EQ(hit.t, 19);
  EXPECT_EQ(hit.primitive_id, 0u);
  EXPECT_EQ(hit.u, 0);
  EXPECT_EQ(hit.v, 0);
}

// Sums and products of parts with exponents far apart, against themselves taken apart again.
TEST(Expansion, ArithmeticIsExact) {
  Random random(6);
  for (int round = 0; round < 2000; ++round) {
    const auto draw = [&] { return std::ldexp(random.uniform(-1, 1), int(random.below(250)) - 125); };
    const auto a = traversal::exact_difference(draw(), draw()), b = traversal::exact_difference(draw(), draw());
    const auto c = traversal::exact_difference(draw(), draw());
    const auto left = (a + b) * c, right = a * c + b * c;
    EXPECT_EQ((left - right).sign(), 0) << "(a + b) c = a c + b c";
    EXPECT_EQ(((a + b) * (a - b) - (a * a - b * b)).sign(), 0) << "(a + b)(a - b) = a^2 - b^2";
    const auto few = traversal::compressed<20>(left);
    EXPECT_EQ((left - few).sign(), 0) << "compressed, it is the same number";
    EXPECT_LE(few.size(), left.size());
    for (int i = 1; i < few.size(); ++i) {
      EXPECT_LE(std::fabs(few[i - 1]), std::ldexp(std::fabs(few[i]), -51)) << "and its parts are far apart";
    }
    EXPECT_EQ(left.sign(), left.estimate() > 0 ? 1 : left.estimate() < 0 ? -1 : 0);
  }
}

}  // namespace
}  // namespace raymill::tests
