// The order in which scattered rays are traced.
#include "traversal/ray_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill::traversal {
namespace {

// As a raster of a floor is walked, row after row.
std::vector<Ray> raster(std::size_t side) {
  std::vector<Ray> rays(side * side);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    rays[i].org = {float(i % side), float(i / side), 0};
    rays[i].dir = {0, 0, i % 3 == 0 ? 1.0F : -1.0F};
  }
  return rays;
}
std::vector<Ray> shuffled(std::vector<Ray> rays) {
  tests::Random random(7);
  for (std::size_t i = rays.size(); i > 1; --i) {
    std::swap(rays[i - 1], rays[random.below(static_cast<std::uint32_t>(i))]);
  }
  return rays;
}
// The way from origin to origin.
double way(std::span<const Ray> rays, std::span<const std::uint32_t> order) {
  double sum = 0;
  for (std::size_t i = 1; i < order.size(); ++i) {
    const auto &a = rays[order[i - 1]].org, &b = rays[order[i]].org;
    sum += std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
  }
  return sum;
}

TEST(RayOrder, IsAPermutationThatBringsNeighboursTogether) {
  RayOrder order;
  for (const std::size_t side : {1u, 5u, 200u, 60u}) {
    const std::vector<Ray> rays = shuffled(raster(side));
    const auto sorted = order.sort(rays);
    ASSERT_EQ(sorted.size(), rays.size());
    std::vector<std::uint32_t> all(sorted.begin(), sorted.end()), unsorted(rays.size());
    std::iota(unsorted.begin(), unsorted.end(), 0);
    if (side > 50) {
      EXPECT_LT(way(rays, sorted), 0.1 * way(rays, unsorted));
    }
    std::sort(all.begin(), all.end());
    EXPECT_EQ(all, unsorted);
  }
  EXPECT_TRUE(order.sort({}).empty());
}

TEST(RayOrder, EqualKeysKeepTheirOrder) {
  const std::vector<Ray> rays(1000, Ray{.org = {1, 2, 3}, .dir = {1, 0, 0}});
  RayOrder order;
  const auto sorted = order.sort(rays);
  EXPECT_TRUE(std::is_sorted(sorted.begin(), sorted.end()));
}

TEST(RayOrder, TellsScatteredRaysFromThoseInOrder) {
  const std::vector<Ray> rays = raster(200);
  EXPECT_FALSE(RayOrder::is_scattered(rays));
  EXPECT_TRUE(RayOrder::is_scattered(shuffled(rays)));
  EXPECT_FALSE(RayOrder::is_scattered(std::vector<Ray>(5000))) << "all from one point";
  EXPECT_FALSE(RayOrder::is_scattered({}));
}

TEST(RayOrder, AnyNumbersWillDo) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity(), kNaN = std::numeric_limits<float>::quiet_NaN();
  std::vector<Ray> rays = shuffled(raster(40));
  const float odd[] = {kNaN, kInfinity, -kInfinity, 3e38F, -3e38F, 1e-45F, -0.0F};
  for (std::size_t i = 0; i < rays.size(); i += 3) {
    rays[i].org[i % 9 / 3] = odd[i % std::size(odd)];
    rays[i].dir[0] = odd[i % 5];
  }
  RayOrder order;
  auto sorted = order.sort(rays);
  std::vector<std::uint32_t> all(sorted.begin(), sorted.end());
  std::sort(all.begin(), all.end());
  EXPECT_EQ(std::unique(all.begin(), all.end()) - all.begin(), std::ptrdiff_t(rays.size()));
  (void)RayOrder::is_scattered(rays);
}

TEST(RayOrder, SortedRaysGiveTheHitsInTheirOwnOrder) {
  const tests::TempFolder folder;
  tests::Random random(3);
  const tests::Scene scene = {tests::soup(random, 3000, 0.1F)};
  const std::string path = tests::build_store(folder, "soup.mill", scene);
  const std::vector<Ray> rays = tests::mixed_rays(random, scene, 150'000);  // more than are sorted together
  tests::TraceSetup setup;
  setup.engine.sort_rays = "never";
  const tests::Traced as_they_come = tests::trace(path, rays, setup);
  setup.engine.sort_rays = "always";
  for (const std::size_t push_rays : {std::size_t{0}, std::size_t{1}, std::size_t{5000}}) {
    setup.push_rays = push_rays;
    const auto some = std::span<const Ray>(rays).first(push_rays == 1 ? 3000 : rays.size());
    const tests::Traced sorted = tests::trace(path, some, setup);
    ASSERT_TRUE(sorted.status.ok()) << sorted.status.message();
    ASSERT_EQ(sorted.hits.size(), some.size());
    for (std::size_t i = 0; i < some.size(); ++i) {
      ASSERT_TRUE(tests::same_bits(sorted.hits[i], as_they_come.hits[i])) << i;
    }
  }
  setup.engine.sort_rays = "sometimes";
  EXPECT_EQ(Engine::create(setup.engine).status().code(), ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace raymill::traversal
