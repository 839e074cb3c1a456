// The embedded engine: jobs from push to next, under little memory, cancelled, dropped, and on stores that are damaged.
#include "traversal/engine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <thread>

#include "storage/pages/store_format.h"
#include "tests/support/effort.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill {
namespace {

using tests::Random;
using tests::TempFolder;
using tests::Traced;
using tests::TraceSetup;

bool same(const std::vector<Hit>& a, const std::vector<Hit>& b) {
  if (a.size() != b.size()) {
    return false;
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!tests::same_bits(a[i], b[i])) {
      return false;
    }
  }
  return true;
}

class EngineTest : public testing::Test {
 protected:
  EngineTest() {
    Random random(1);
    path_ = tests::build_store(folder_, "scene.mill", {tests::soup(random, 12000, 0.1F), tests::grid(10, 0.1F)});
    rays_ = tests::random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 8000);
  }
  // Results that are not fetched go to the test's folder.
  TraceSetup spilling(unsigned threads = 1) {
    TraceSetup setup;
    setup.engine.threads = threads;
    setup.engine.spill_directory = folder_.path();
    return setup;
  }
  std::unique_ptr<Engine> engine(unsigned max_jobs = 1, unsigned threads = 2) {
    EngineConfig config;
    config.memory = gibibytes(8);
    config.threads = threads;
    config.max_jobs = max_jobs;
    auto created = Engine::create(config);
    EXPECT_TRUE(created.ok()) << created.status().message();
    return std::move(*created);
  }

  TempFolder folder_;
  std::string path_;
  std::vector<Ray> rays_;
};

TEST_F(EngineTest, LeastMemoryGivesTheHitsOfPlenty) {
  const Traced plenty = tests::trace(path_, rays_);
  ASSERT_TRUE(plenty.status.ok()) << plenty.status.message();
  ASSERT_EQ(plenty.hits.size(), rays_.size());
  for (const unsigned threads : {1u, 3u}) {
    const Traced least = tests::trace_with_least_memory(path_, rays_, spilling(threads));
    ASSERT_TRUE(least.status.ok()) << least.status.message();
    EXPECT_TRUE(same(plenty.hits, least.hits));
    EXPECT_GT(least.stats.rays_parked, 0u) << "paging was forced";
    EXPECT_GT(least.stats.pages_read, least.stats.distinct_pages);
    EXPECT_GT(least.stats.pages_entered, least.stats.rays_parked) << "each time a ray waited it came there afterwards";
    EXPECT_LE(least.stats.reads, least.stats.pages_read);
    EXPECT_GE(least.stats.mean_read_depth, 1);
    EXPECT_LE(least.stats.peak_in_flight, least.stats.most_in_flight);
  }
}

TEST_F(EngineTest, EverythingPushedBeforeTheFirstNextIsSpilledAndComesInOrder) {
  const Traced plenty = tests::trace(path_, rays_);
  const Traced least = tests::trace_with_least_memory(path_, rays_, spilling());
  EXPECT_GT(least.stats.result_spill_bytes, 0u);
  EXPECT_TRUE(same(plenty.hits, least.hits));
  EXPECT_EQ(folder_.files(), 2u) << "the scene and its store; what was spilled has no name";
}

TEST_F(EngineTest, FetchingInOneThreadWhilePushingInAnother) {
  const Traced plenty = tests::trace(path_, rays_);
  EngineConfig little = spilling(2).engine;
  tests::set_least_memory(path_, little);
  little.memory += mebibytes(1);
  const auto created = Engine::create(little);
  ASSERT_TRUE(created);
  const auto store = (*created)->open(path_);
  ASSERT_TRUE(store);
  TraceConfig config;
  config.fields = Field::all;
  const auto job = (*store)->trace(config);
  ASSERT_TRUE(job);
  std::thread pusher([&] {
    for (std::size_t i = 0; i < rays_.size(); i += 777) {
      EXPECT_TRUE((*job)->push(std::span(rays_).subspan(i, std::min<std::size_t>(777, rays_.size() - i))).ok());
    }
    EXPECT_TRUE((*job)->finish().ok());
  });
  std::vector<Hit> hits;
  std::uint64_t index = 0;
  while (auto chunk = (*job)->next()) {
    EXPECT_EQ(chunk->index(), index++);
    EXPECT_EQ(chunk->first_ray(), hits.size());
    for (std::size_t i = 0; i < chunk->size(); ++i) {
      hits.push_back(chunk->hit(i));
    }
  }
  pusher.join();
  EXPECT_TRUE((*job)->status().ok());
  EXPECT_TRUE(same(plenty.hits, hits));
}

TEST_F(EngineTest, TooLittleMemoryNamesTheLeastAndTheLeastWorks) {
  TraceSetup setup = spilling();
  tests::set_least_memory(path_, setup.engine);
  setup.engine.memory /= 2;
  const Status status = tests::trace(path_, rays_, setup).status;
  EXPECT_EQ(status.code(), ErrorCode::budget_exceeded);
  EXPECT_NE(status.message().find("needs at least"), std::string::npos) << status.message();
  setup.engine.memory = 1;
  EXPECT_EQ(tests::trace(path_, rays_, setup).status.code(), ErrorCode::budget_exceeded);
}

TEST_F(EngineTest, EmptyJobEndsAtOnce) {
  const Traced traced = tests::trace(path_, {});
  EXPECT_TRUE(traced.status.ok());
  EXPECT_TRUE(traced.hits.empty());
  EXPECT_EQ(traced.stats.trace_seconds, 0);
}

TEST_F(EngineTest, InvalidRaysAreCountedAndStopNothing) {
  std::vector<Ray> rays = tests::hostile_rays();
  const std::size_t hostile = rays.size();
  rays.insert(rays.end(), rays_.begin(), rays_.begin() + 100);
  const Traced traced = tests::trace(path_, rays);
  ASSERT_TRUE(traced.status.ok());
  ASSERT_EQ(traced.hits.size(), rays.size());
  std::size_t invalid = 0;
  for (const Hit& hit : traced.hits) {
    invalid += std::isnan(hit.t) ? 1 : 0;
  }
  EXPECT_EQ(traced.stats.invalid, invalid);
  EXPECT_GT(invalid, 10u);
  EXPECT_LT(invalid, hostile);
  Ray nothing;
  const Traced only_invalid = tests::trace(path_, {&nothing, 1});
  EXPECT_TRUE(std::isnan(only_invalid.hits.at(0).t));
  EXPECT_GE(only_invalid.stats.trace_seconds, 0) << "no ray was traced";
}

TEST_F(EngineTest, HitBeyondFloat32IsAMiss) {
  const std::string path = tests::build_store(folder_, "far.mill", {tests::moved(tests::grid(1), {}, 1e20F)});
  const Ray slow = tests::ray({5e19F, 2e19F, -1e20F}, {0, 0, 1e-25F});
  const Traced traced = tests::trace(path, {&slow, 1});
  EXPECT_EQ(traced.hits.at(0).t, std::numeric_limits<float>::infinity());
  EXPECT_EQ(traced.hits.at(0).primitive_id, kNoId);
  EXPECT_EQ(traced.stats.hits, 0u);
}

TEST_F(EngineTest, CancelHalfWayEndsTheJobAndFreesItsPlace) {
  const auto engine_ = engine();
  const auto store = *engine_->open(path_);
  for (int i = 0; i < 10; ++i) {
    const auto job = store->trace({});
    ASSERT_TRUE(job) << job.status().message();
    EXPECT_EQ(store->trace({}).status().code(), ErrorCode::busy_retry);
    EXPECT_TRUE((*job)->push(rays_).ok());
    (*job)->cancel();
    EXPECT_EQ((*job)->push(rays_).code(), ErrorCode::cancelled);
    EXPECT_FALSE((*job)->next());
    EXPECT_EQ((*job)->status().code(), ErrorCode::cancelled);
    (*job)->cancel();
  }
  EXPECT_EQ(tests::run_job(**store->trace({}), rays_).hits.size(), rays_.size());
}

TEST_F(EngineTest, JobsDroppedAtAnyTimeLeaveTheStoreUsable) {
  const auto engine_ = engine();
  const auto store = *engine_->open(path_);
  for (std::size_t i = 0; i < (tests::kSanitized ? 8 : 20); ++i) {
    auto job = *store->trace({});
    EXPECT_TRUE(job->push(std::span(rays_).first(i * 400)).ok());
    if (i % 2 == 0) {
      (void)job->finish();
      (void)job->next();
    }
  }
  EXPECT_EQ(tests::run_job(**store->trace({}), rays_).hits.size(), rays_.size());
}

// Stores and jobs keep what they need of the engine alive; so does a chunk.
TEST_F(EngineTest, JobAndChunkOutliveStoreAndEngine) {
  auto engine_ = engine();
  auto store = *engine_->open(path_);
  auto job = *store->trace({});
  engine_.reset();
  store.reset();
  EXPECT_TRUE(job->push(rays_).ok());
  EXPECT_TRUE(job->finish().ok());
  auto chunk = job->next();
  ASSERT_TRUE(chunk);
  job.reset();
  EXPECT_GT(chunk->size(), 0u);
  EXPECT_FALSE(std::isnan(chunk->hit(0).t));
}

TEST_F(EngineTest, TwoJobsAtOnceGiveTheirOwnHits) {
  const Traced plenty = tests::trace(path_, rays_);
  const auto engine_ = engine(2);
  const auto store = *engine_->open(path_);
  TraceConfig all;
  all.fields = Field::all;
  auto first = *store->trace(all), second = *store->trace(all);
  EXPECT_EQ(store->trace(all).status().code(), ErrorCode::busy_retry);
  std::vector<Ray> reversed(rays_.rbegin(), rays_.rend());
  Traced a, b;
  std::thread other([&] { b = tests::run_job(*second, reversed, 500); });
  a = tests::run_job(*first, rays_, 700);
  other.join();
  std::reverse(b.hits.begin(), b.hits.end());
  EXPECT_TRUE(same(a.hits, plenty.hits));
  EXPECT_TRUE(same(b.hits, plenty.hits));
}

TEST_F(EngineTest, EveryStoreAboveTheLimitIsToldToRetry) {
  const auto engine_ = engine();
  const std::string other = tests::build_store(folder_, "other.mill", {tests::grid(4)});
  auto store = *engine_->open(path_);
  EXPECT_TRUE(engine_->open(path_)) << "an open store is shared";
  EXPECT_EQ(engine_->open(other).status().code(), ErrorCode::busy_retry);
  store.reset();
  EXPECT_TRUE(engine_->open(other));
}

TEST_F(EngineTest, RequestsThatCannotBeAreRefused) {
  EngineConfig config;
  config.memory = gibibytes(8);
  config.isa = "mmx";
  const Status status = Engine::create(config).status();
  EXPECT_EQ(status.code(), ErrorCode::invalid_argument);
  EXPECT_NE(status.message().find(available_isas().back()), std::string::npos)
      << "names what there is: " << status.message();
  config.isa.clear();
  config.max_jobs = 0;
  EXPECT_EQ(Engine::create(config).status().code(), ErrorCode::invalid_argument);
  const auto engine_ = engine();
  EXPECT_EQ(engine_->open(folder_ / "none.mill").status().code(), ErrorCode::not_found);
  const auto store = *engine_->open(path_);
  TraceConfig nothing;
  nothing.fields = Field::none;
  EXPECT_EQ(store->trace(nothing).status().code(), ErrorCode::invalid_argument);
  const auto job = *store->trace({});
  EXPECT_TRUE(job->finish().ok());
  EXPECT_EQ(job->push(rays_).code(), ErrorCode::invalid_argument);
}

// Pages damaged after the store was opened: the jobs that need them fail, and nothing hangs.
TEST_F(EngineTest, PageDamagedWhileOpenFailsTheJobWithItsName) {
  const std::string bytes = tests::read_file(path_);
  storage::StoreFooter footer;
  std::memcpy(&footer, bytes.data() + bytes.size() - sizeof footer, sizeof footer);
  for (const std::uint64_t page : {std::uint64_t{0}, footer.page_count / 2, footer.page_count - 1}) {
    storage::PageEntry entry;
    std::memcpy(&entry, bytes.data() + footer.directory_offset + page * sizeof entry, sizeof entry);
    tests::write_file(folder_ / "copy.mill", bytes);
    const auto engine_ = engine();
    const auto store = *engine_->open(folder_ / "copy.mill");
    tests::flip(folder_ / "copy.mill", entry.offset + 40, 0x10);
    const Traced traced = tests::run_job(**store->trace({}), rays_, 1000);
    EXPECT_EQ(traced.status.code(), ErrorCode::checksum_mismatch);
    EXPECT_NE(traced.status.message().find("page " + std::to_string(page)), std::string::npos)
        << traced.status.message();
    EXPECT_FALSE(store->trace({}).status().code() == ErrorCode::busy_retry) << "the failed job gave its place back";
  }
}

TEST_F(EngineTest, CallersFloatModeChangesNothing) {
  const std::string path = tests::build_store(folder_, "small.mill", {tests::moved(tests::grid(8, 0.2F), {}, 1e-37F)});
  Random random(3);
  std::vector<Ray> rays;
  for (int i = 0; i < 500; ++i) {
    rays.push_back(tests::ray({random.uniform(0, 1e-37F), random.uniform(0, 1e-37F), 1e-36F}, {0, 0, -1}));
  }
  for (const Mode mode : {Mode::watertight, Mode::exact}) {
    tests::TraceSetup setup;
    setup.trace.mode = mode;
    const Traced before = tests::trace(path, rays, setup);
#if defined(__x86_64__)
    const unsigned control = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr(control | 0x8040 | 0x6000);  // flush to zero, denormals are zero, round towards zero
#endif
    const Traced during = tests::trace(path, rays, setup);
#if defined(__x86_64__)
    __builtin_ia32_ldmxcsr(control);
#endif
    EXPECT_TRUE(same(before.hits, during.hits)) << to_string(mode);
    EXPECT_GT(before.stats.hits, 400u) << to_string(mode);
  }
}

TEST_F(EngineTest, InfoSaysWhatTheStoreHolds) {
  const auto engine_ = engine();
  const auto info = (*engine_->open(path_))->info();
  ASSERT_TRUE(info);
  EXPECT_EQ(info->triangles, 12000u + 200);
  EXPECT_EQ(info->geometries, 2u);
  EXPECT_EQ(info->codec, "zstd");
  EXPECT_EQ(info->width, 8u);
  EXPECT_EQ(info->positions, "float32");
  EXPECT_GT(info->least_memory_bytes, mebibytes(1));
  EXPECT_LE(info->bounds_min[0], -0.9F);
  EXPECT_EQ(info->features, (std::vector<std::string>{"triangles", "geometry_ids"}));
}

TEST_F(EngineTest, StatsAddUp) {
  const Traced traced = tests::trace(path_, rays_);
  std::size_t hits = 0;
  for (const Hit& hit : traced.hits) {
    hits += hit.primitive_id != kNoId ? 1 : 0;
  }
  EXPECT_EQ(traced.stats.rays, rays_.size());
  EXPECT_EQ(traced.stats.hits, hits);
  EXPECT_GT(traced.stats.nodes_visited, rays_.size());
  EXPECT_GT(traced.stats.triangles_tested, hits);
  EXPECT_EQ(traced.stats.pages_read, traced.stats.distinct_pages) << "plenty of memory: each page once";
  EXPECT_GE(traced.stats.pages_entered, traced.stats.rays);
  EXPECT_GT(traced.stats.peak_in_flight, 0u);
  EXPECT_EQ(traced.stats.isa, available_isas().front());
}

}  // namespace
}  // namespace raymill
