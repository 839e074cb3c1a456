#include "traversal/future_demand.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "traversal/kernel.h"
#include "traversal/lone_page.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {
namespace {

// Rays on a store's pages, one page there at a time: each suspends at every page border.
class FutureDemandTest : public testing::TestWithParam<unsigned> {
 protected:
  FutureDemandTest() {
    tests::Random random(3);
    const tests::Scene scene = {tests::soup(random, 4000, 0.2F), tests::grid(30, 0.3F)};
    pages_ = tests::load_pages(tests::build_pages(scene, GetParam()));
    all_ = std::make_shared<FutureDemand>(page_count(), pages_.rules.width);
    images_ = std::make_unique<std::atomic<const std::byte*>[]>(page_count());
    touched_ = std::make_unique<std::atomic<std::uint8_t>[]>(page_count());
    kernel_ = find_kernel(runnable_isas().back(), {Query::any, Mode::fast, GetParam()});
    for (const Ray& ray : tests::mixed_rays(random, scene, 500)) {
      if (TraceJob::valid(ray)) {
        rays_.push_back(start(ray));
      }
    }
  }

  [[nodiscard]] std::uint32_t page_count() const { return static_cast<std::uint32_t>(pages_.images.size()); }
  [[nodiscard]] const std::byte* image(std::uint32_t page) const { return pages_.images[page].data(); }

  RayState start(const Ray& ray) const {
    RayState state;
    state.org = ray.org;
    state.dir = ray.dir;
    state.tnear = ray.tnear;
    state.tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
    state.page = pages_.root_page;
    state.node = pages_.root_node;
    return state;  // number 0: every ray is sampled
  }

  // Takes the ray up where it waits and runs it as far as that page goes.
  void step(RayState& ray, FutureDemand::Share& share) {
    const std::uint32_t page = ray.page;
    share.taken_up({&ray, 1}, image(page));
    images_[page] = image(page);
    KernelContext context;
    context.images = images_.get();
    context.touched = touched_.get();
    ray.left = {};
    kernel_(context, {&ray, 1});
    ASSERT_FALSE(context.corrupt);
    images_[page] = nullptr;
    share.put_back({&ray, 1}, page, image(page));
  }

  [[nodiscard]] std::int64_t total() const {
    std::int64_t sum = 0;
    for (const auto& count : all_->counts()) {
      EXPECT_GE(count.load(), 0);
      sum += count.load();
    }
    return sum;
  }

  tests::LoadedPages pages_;
  std::shared_ptr<FutureDemand> all_;
  std::unique_ptr<std::atomic<const std::byte*>[]> images_;
  std::unique_ptr<std::atomic<std::uint8_t>[]> touched_;
  Kernel kernel_ = nullptr;
  std::vector<RayState> rays_;
};

TEST_P(FutureDemandTest, WhatParkingAddsTakingUpTakesAway) {
  ASSERT_GT(page_count(), 8u);
  FutureDemand::Share share(all_);
  std::int64_t most = 0;
  for (bool some = true; some;) {
    some = false;
    for (RayState& ray : rays_) {
      if (!ray.done) {
        step(ray, share);
        some = true;
      }
    }
    most = std::max(most, total());
  }
  EXPECT_GT(most, static_cast<std::int64_t>(rays_.size()) / 4) << "rays that wait have more to visit";
  EXPECT_EQ(total(), 0);
}

TEST_P(FutureDemandTest, RayThatHitsNothingComesToEveryPageThatIsCounted) {
  std::size_t pages_told = 0;
  for (RayState ray : rays_) {
    FutureDemand::Share share(all_);
    std::set<std::uint32_t> told, come;
    while (!ray.done) {
      step(ray, share);
      come.insert(ray.page);
      for (std::uint32_t page = 0; page < page_count(); ++page) {
        if (all_->counts()[page].load() > 0) {
          told.insert(page);
        }
      }
    }
    if (!ray.has_hit) {
      EXPECT_TRUE(std::includes(come.begin(), come.end(), told.begin(), told.end()));
      pages_told += told.size();
    }
  }
  EXPECT_GT(pages_told, 50u);
}

TEST_P(FutureDemandTest, JobThatEndsTakesItsCountsAway) {
  {
    FutureDemand::Share share(all_);
    for (RayState& ray : rays_) {
      step(ray, share);
    }
    EXPECT_GT(total(), 0);
  }
  EXPECT_EQ(total(), 0);
}

TEST_P(FutureDemandTest, OneRayInSixteenIsCounted) {
  FutureDemand::Share share(all_);
  for (RayState& ray : rays_) {
    ray.number = 1;
    step(ray, share);
  }
  EXPECT_EQ(total(), 0);
}

TEST_P(FutureDemandTest, RaysThatSuspendAtEveryNodeAreCountedAlike) {
  LonePage lone(pages_.rules);
  FutureDemand::Share share(all_);
  std::size_t steps = 0, inside = 0;
  for (RayState& ray : rays_) {
    RayState whole = ray;
    while (!ray.done) {
      const std::uint32_t page = ray.page;
      share.taken_up({&ray, 1}, image(page));
      KernelContext context;
      context.images = lone.show(page, image(page));
      context.touched = touched_.get();
      ray.left = {};
      kernel_(context, {&ray, 1});
      ASSERT_FALSE(context.corrupt);
      ASSERT_LE(context.counters.nodes_visited, 1u) << "a ray suspends at every node";
      lone.settle({&ray, 1}, image(page));
      ASSERT_LT(ray.page, page_count());
      inside += !ray.done && ray.page == page ? 1 : 0;
      ++steps;
      share.put_back({&ray, 1}, page, image(page));
    }
    while (!whole.done) {
      step(whole, share);
    }
    EXPECT_EQ(ray.has_hit, whole.has_hit);
  }
  EXPECT_GT(steps, 4 * rays_.size());
  EXPECT_GT(inside, steps / 8);
  EXPECT_EQ(total(), 0);
}

INSTANTIATE_TEST_SUITE_P(Widths, FutureDemandTest, testing::Values(4u, 8u));

}  // namespace
}  // namespace raymill::traversal
