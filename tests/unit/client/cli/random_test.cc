#include "client/cli/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "client/cli/sampling.h"

namespace raymill::client {
namespace {

TEST(Permute, IsABijection) {
  for (const std::uint64_t count : {1ULL, 2ULL, 3ULL, 64ULL, 65ULL, 1000ULL, 4097ULL}) {
    std::vector<bool> seen(count);
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t place = permute(i, count, 42);
      ASSERT_LT(place, count);
      ASSERT_FALSE(seen[place]);
      seen[place] = true;
    }
  }
}

TEST(Random, SameKeySameDraws) {
  Random a(5), b(5), c(6);
  EXPECT_EQ(a.bits(), b.bits());
  EXPECT_NE(a.bits(), c.bits());
  double sum = 0;
  for (int i = 0; i < 10000; ++i) {
    const float x = a.unit();
    ASSERT_GE(x, 0.0F);
    ASSERT_LT(x, 1.0F);
    sum += x;
    const std::uint32_t whole = a.whole(3, 5);
    ASSERT_GE(whole, 3U);
    ASSERT_LE(whole, 5U);
  }
  EXPECT_NEAR(sum / 10000, 0.5, 0.02);
}

TEST(Sampling, DirectionsFillTheHemisphereByTheCosine) {
  Random random(1);
  for (const Vector3& normal : {Vector3{0, 1, 0}, Vector3{0, 0, -1}, Vector3{0.6F, 0, -0.8F}}) {
    double sum = 0;
    constexpr int kDraws = 20000;
    for (int i = 0; i < kDraws; ++i) {
      const Vector3 d = cosine_direction(normal, random);
      const double cosine = double(d[0]) * normal[0] + double(d[1]) * normal[1] + double(d[2]) * normal[2];
      ASSERT_GE(cosine, -1e-6);
      ASSERT_NEAR(std::hypot(d[0], d[1], d[2]), 1, 1e-5);
      sum += cosine;
    }
    EXPECT_NEAR(sum / kDraws, 2.0 / 3, 0.01);
  }
}

TEST(Sampling, SurfaceLiesOnTheRaysSide) {
  const Ray ray{.org = {0, 10, 0}, .dir = {0, -2, 0}};
  Hit hit;
  hit.t = 5;
  for (const float y : {1.0F, -1.0F}) {
    hit.normal = {0, y, 0};
    const Surface surface = surface_of(ray, hit);
    EXPECT_EQ(surface.normal, (Vector3{0, 1, 0}));
    EXPECT_GT(surface.origin[1], 0);
    EXPECT_LT(surface.origin[1], 1e-3F);
  }
}

}  // namespace
}  // namespace raymill::client
