// Rays for the expanded layout: blocks go round, and a job ends well whatever its rays and however they are pushed.
#include "traversal/fresh_rays.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill {
namespace {

using tests::Random;
using traversal::FreshRays;

TEST(FreshRaysTest, BlocksGoRoundFirstInFirstOut) {
  storage::Ledger ledger(mebibytes(64));
  const auto rays = *FreshRays::create({.threads = 3}, ledger);
  std::vector<FreshRays::Block*> blocks;
  while (rays->has_room()) {
    blocks.push_back(rays->take());
    EXPECT_EQ(blocks.back()->count, 0U);
    blocks.back()->count = static_cast<std::uint32_t>(blocks.size());
    rays->put(blocks.back());
  }
  EXPECT_LE(blocks.size() * sizeof(FreshRays::Block), FreshRays::bytes({.threads = 3}));
  EXPECT_FALSE(rays->has_much_room());
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    ASSERT_TRUE(rays->has_ready());
    FreshRays::Block* block = rays->next();
    EXPECT_EQ(block, blocks[i]);
    EXPECT_EQ(block->count, i + 1);
    rays->give_back(block);
    EXPECT_EQ(rays->has_much_room(), 2 * (i + 1) >= blocks.size());
  }
  EXPECT_FALSE(rays->has_ready());
  EXPECT_EQ(rays->take()->count, 0U) << "the rays that it had are gone";
}

TEST(FreshRaysTest, ClearDropsWhatWaitsAndFreesItsRoom) {
  storage::Ledger ledger(mebibytes(64));
  const auto rays = *FreshRays::create({.threads = 1}, ledger);
  while (rays->has_room()) {
    rays->put(rays->take());
  }
  rays->clear();
  EXPECT_FALSE(rays->has_ready());
  EXPECT_TRUE(rays->has_much_room());
}

TEST(FreshRaysTest, MemoryIsClaimedOrRefused) {
  storage::Ledger ledger(FreshRays::bytes({.threads = 2, .skipped = true, .masks = true}));
  const auto rays = FreshRays::create({.threads = 2, .skipped = true, .masks = true}, ledger);
  ASSERT_TRUE(rays);
  EXPECT_EQ(FreshRays::create({.threads = 2, .skipped = true, .masks = true}, ledger).status().code(),
            ErrorCode::budget_exceeded);
}

class FreshJobTest : public testing::Test {
 protected:
  FreshJobTest() {
    Random random(7);
    scene_ = {tests::soup(random, 2000, 0.1F)};
    path_ = tests::build_store(folder_, "scene.mill", scene_, tests::small_pages());
    rays_ = tests::mixed_rays(random, scene_, 9000);
  }
  [[nodiscard]] static EngineConfig config(const std::string& layout, unsigned threads) {
    EngineConfig config;
    config.layout = layout;
    config.threads = threads;
    return config;
  }

  tests::TempFolder folder_;
  tests::Scene scene_;
  std::string path_;
  std::vector<Ray> rays_;
};

TEST_F(FreshJobTest, BlocksWithInvalidRaysAloneAreAnswered) {
  const auto engine = *Engine::create(config("expanded", 2));
  const auto store = *engine->open(path_);
  std::vector<Ray> rays(5000, rays_[0]);
  for (std::size_t i = 0; i < 3000; ++i) {
    rays[i].dir = {0, 0, 0};
  }
  const tests::Traced traced = tests::run_job(**store->trace({}), rays);
  ASSERT_TRUE(traced.status.ok()) << traced.status.message();
  EXPECT_EQ(traced.stats.invalid, 3000U);
  EXPECT_EQ(traced.stats.rays_expanded, 2000U);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_EQ(std::isnan(traced.hits[i].t), i < 3000) << i;
  }
}

TEST_F(FreshJobTest, JobsDroppedAtAnyTimeLeaveTheStoreUsable) {
  const auto engine = *Engine::create(config("expanded", 2));
  const auto store = *engine->open(path_);
  for (std::size_t i = 0; i < 8; ++i) {
    auto job = *store->trace({});
    EXPECT_TRUE(job->push(std::span(rays_).first(i * 1000)).ok());
    if (i % 2 == 0) {
      (void)job->finish();
      (void)job->next();
    }
  }
  EXPECT_EQ(tests::run_job(**store->trace({}), rays_).hits.size(), rays_.size());
}

TEST_F(FreshJobTest, CancellingWakesAPusherThatWaitsForRoom) {
  const auto engine = *Engine::create(config("expanded", 1));
  const auto store = *engine->open(path_);
  const auto job = *store->trace({});
  // Nobody fetches, so push() waits sooner or later.
  std::thread pusher([&] {
    Status status;
    for (int i = 0; i < 100'000 && status.ok(); ++i) {
      status = job->push(rays_);
    }
    EXPECT_EQ(status.code(), ErrorCode::cancelled);
  });
  while (job->progress().rays_done == 0) {
    std::this_thread::yield();
  }
  job->cancel();
  pusher.join();
}

TEST_F(FreshJobTest, RaysOnBothSidesOfTheChangeComeInOrder) {
  const auto compact = tests::run_job(**(*(*Engine::create(config("compact", 1)))->open(path_))->trace({}), rays_);
  for (const unsigned threads : {1u, 4u}) {
    const auto engine = *Engine::create(config("auto", threads));
    const auto store = *engine->open(path_);
    // In small pushes: some rays wait as records at the root page when the tree comes.
    const tests::Traced both = tests::run_job(**store->trace({}), rays_, 37);
    ASSERT_EQ(both.hits.size(), compact.hits.size());
    for (std::size_t i = 0; i < rays_.size(); ++i) {
      ASSERT_TRUE(tests::same_bits(both.hits[i], compact.hits[i])) << i;
    }
  }
}

}  // namespace
}  // namespace raymill
