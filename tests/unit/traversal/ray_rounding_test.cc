#include "traversal/ray_rounding.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace raymill::traversal {
namespace {

constexpr double kWideInfinity = std::numeric_limits<double>::infinity();
constexpr double kWideNan = std::numeric_limits<double>::quiet_NaN();
constexpr float kMostFloat = std::numeric_limits<float>::max();

Ray interval(double tnear, double tfar) { return round_ray({.tnear = tnear, .dir = {0, 0, 1}, .tfar = tfar}); }

TEST(RayRounding, OriginAndDirectionGoToTheNearest) {
  const Ray ray = round_ray({.org = {0.1, 16777217, 16777219}, .dir = {-0.3, 1e-40, -0.0}, .tfar = 1});
  EXPECT_EQ(ray.org, (std::array<float, 3>{0.1F, 16777216, 16777220}));
  EXPECT_EQ(ray.dir, (std::array<float, 3>{-0.3F, 1e-40F, 0}));
  EXPECT_TRUE(std::signbit(ray.dir[2]));
}

TEST(RayRounding, TheIntervalLiesInTheOneOfTheFile) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> exponent(-140, 150), sign(-1, 1);
  for (int i = 0; i < 100000; ++i) {
    const double a = std::copysign(std::exp2(exponent(random)), sign(random));
    const double b = std::copysign(std::exp2(exponent(random)), sign(random));
    const Ray ray = interval(std::min(a, b), std::max(a, b));
    if (std::isinf(ray.tnear)) {
      EXPECT_GT(std::min(std::abs(a), std::abs(b)), double(kMostFloat));  // nothing that float32 could hold lies in it
      continue;
    }
    ASSERT_GE(double(ray.tnear), std::min(a, b));
    ASSERT_LE(double(ray.tfar), std::max(a, b));
    ASSERT_LE(ray.tnear, ray.tfar);
  }
}

TEST(RayRounding, AnIntervalWithoutAFloat32StaysValid) {
  const Ray point = interval(0.1, 0.1);
  EXPECT_EQ(point.tnear, 0.1F);
  EXPECT_EQ(point.tfar, 0.1F);
  const double one = 1 + 0x1p-40;
  const Ray narrow = interval(one, one + 0x1p-41);
  EXPECT_EQ(narrow.tnear, 1);
  EXPECT_EQ(narrow.tfar, 1);
  const Ray far = interval(1e200, 1e201);
  EXPECT_TRUE(std::isinf(far.tnear) && std::isinf(far.tfar));
}

TEST(RayRounding, InvalidRaysStayInvalid) {
  const double one = 1 + 0x1p-40;
  for (const auto& [tnear, tfar] : {std::pair(one, 1.0), std::pair(one + 0x1p-41, one), std::pair(1e300, 1e299),
                                    std::pair(kWideInfinity, 0.0), std::pair(0.0, -1e-300)}) {
    const Ray crossed = interval(tnear, tfar);
    EXPECT_GT(crossed.tnear, crossed.tfar) << tnear << " " << tfar;
  }
  EXPECT_TRUE(std::isnan(interval(kWideNan, 1).tnear));
  EXPECT_TRUE(std::isnan(interval(0, kWideNan).tfar));
  const Ray ray = round_ray({.org = {kWideNan, kWideInfinity, -kWideInfinity}, .tfar = 1});
  EXPECT_TRUE(std::isnan(ray.org[0]));
  EXPECT_TRUE(std::isinf(ray.org[1]) && std::isinf(ray.org[2]));
  EXPECT_EQ(ray.dir, (std::array<float, 3>{}));
}

TEST(RayRounding, BeyondFloat32) {
  const Ray ray = round_ray({.org = {1e39, 0, 0}, .tnear = -1e300, .dir = {1e-46, 0, 0}, .tfar = 1e300});
  EXPECT_TRUE(std::isinf(ray.org[0]));
  EXPECT_EQ(ray.dir[0], 0);
  EXPECT_EQ(ray.tnear, -kMostFloat);
  EXPECT_EQ(ray.tfar, kMostFloat);
  EXPECT_TRUE(std::isinf(interval(0, kWideInfinity).tfar));
}

// The exact difference, once rounded: long double holds all of it where the exponents are near, and at ties of float32
// that the difference in float64 would come to stand on.
TEST(RayRounding, OriginIsSubtractedExactly) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> place(-1e7, 1e7), near(-2000, 2000);
  for (int i = 0; i < 100000; ++i) {
    const double origin = place(random), org = origin + near(random);
    const auto exact = static_cast<float>(static_cast<long double>(org) - static_cast<long double>(origin));
    ASSERT_EQ(round_ray({.org = {org, 0, 0}}, {origin, 0, 0}).org[0], exact) << org << " - " << origin;
  }
  // 1 + 2^-24 is a tie; what is a little more or less is none, and float64 alone would round it to the tie.
  constexpr double kTie = 1 + 0x1p-24;
  EXPECT_EQ(round_ray({.org = {kTie, kTie, kTie}}, {-0x1p-80, 0x1p-80, 0}).org,
            (std::array<float, 3>{1 + 0x1p-23F, 1, 1}));
}

TEST(RayRounding, MovingLeavesAllButTheOriginOfARay) {
  const Ray ray{.org = {100, -200, 300}, .tnear = 1, .dir = {-0.0F, 1e-40F, 3e38F}, .tfar = 2};
  const Ray moved = moved_ray(ray, {99.5, 0, 1e6});
  EXPECT_EQ(moved.org, (std::array<float, 3>{0.5F, -200, -999700}));
  EXPECT_EQ(moved.tnear, 1);
  EXPECT_EQ(moved.tfar, 2);
  EXPECT_EQ(moved.dir, ray.dir);
  EXPECT_TRUE(std::signbit(moved.dir[0]));
  const Ray bad{.org = {INFINITY, -INFINITY, NAN}};
  const Ray still = moved_ray(bad, {1, 2, 3});
  EXPECT_TRUE(std::isinf(still.org[0]) && std::isinf(still.org[1]) && std::isnan(still.org[2]));
}

// Both float32 together are the difference but for 2^-48 of it, and 0 where that is no number.
TEST(RayRounding, WhatFloat32LeavesOfOrgIsTheRest) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> place(-1e7, 1e7), exponent(-20, 24);
  for (int i = 0; i < 100000; ++i) {
    const double org = place(random),
                 origin = i % 3 == 0 ? 0 : std::copysign(std::exp2(exponent(random)), place(random));
    const Ray near = round_ray({.org = {org, 0, 0}, .dir = {0, 0, 1}}, {origin, 0, 0});
    const auto rest = rest_of_org({org, 0, 0}, {origin, 0, 0});
    const long double exact = static_cast<long double>(org) - static_cast<long double>(origin);
    const long double both = static_cast<long double>(near.org[0]) + static_cast<long double>(rest[0]);
    ASSERT_LE(std::fabs(static_cast<double>(both - exact)), std::fabs(static_cast<double>(exact)) * 0x1p-47) << org;
    ASSERT_EQ(near.org[0] + rest[0], near.org[0]) << "half a step at most";
  }
  EXPECT_EQ(rest_of_org({1e39, kWideNan, kWideInfinity}, {}), (std::array<float, 3>{}));
  EXPECT_EQ(rest_of_org({1, -0.0, 0x1p-149}, {}), (std::array<float, 3>{}));
}

}  // namespace
}  // namespace raymill::traversal
