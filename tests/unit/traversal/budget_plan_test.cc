#include "traversal/budget_plan.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "storage/cache/page_cache.h"
#include "storage/io/page_reader.h"
#include "tests/support/stores.h"

namespace raymill::traversal {
namespace {

using storage::Ledger;
using storage::StoreFile;

// What a tracer with this plan claims, piece by piece.
std::uint64_t claimed_beside_jobs(const StoreFile& store, const BudgetPlan& plan) {
  return std::uint64_t(plan.frame_count) * store.header().page_bytes +
         storage::PageCache::table_bytes(store.page_count(), plan.frame_count) +
         storage::page_reader_bytes(store, plan.read_depth) + plan.worker_bytes;
}

// The same with `jobs` jobs of the largest kind.
std::uint64_t claimed_bytes(const StoreFile& store, const BudgetPlan& plan, unsigned jobs) {
  std::uint64_t job = 0;
  for (const Field fields : {Field::all, Field::t, Field::count, Field::ids, kDefaultClosestFields, Field::normal}) {
    for (const bool lists : {false, true}) {
      job = std::max(job, job_bytes(plan_job(plan, store.page_count(), {.fields = fields, .lists = lists})));
    }
  }
  return claimed_beside_jobs(store, plan) + jobs * job;
}

class BudgetPlanTest : public testing::Test {
 protected:
  std::shared_ptr<const StoreFile> open(std::size_t triangles, std::uint32_t page_bytes, const char* codec) {
    tests::Random random(1);
    BuildConfig config = tests::small_pages();
    config.page_bytes = page_bytes;
    config.codec = codec;
    return *StoreFile::open(tests::build_store(folder_, "scene.mill", {tests::soup(random, triangles)}, config),
                            ledger_);
  }
  tests::TempFolder folder_;
  Ledger ledger_{gibibytes(4)};
};

TEST_F(BudgetPlanTest, ClaimsNeverPassTheShareAndTheLeastIsEnough) {
  for (const std::uint32_t page_bytes : {16u << 10, 64u << 10, 256u << 10}) {
    for (const std::size_t triangles : {10, 20000}) {
      const auto store = open(triangles, page_bytes, page_bytes == 16u << 10 ? "raw" : "zstd");
      for (const unsigned threads : {1u, 2u, 7u, 64u}) {
        for (const unsigned jobs : {1u, 3u, 40u}) {
          const std::uint64_t least = least_share_bytes(*store, threads, jobs);
          EXPECT_EQ(plan_budget(*store, {least - 1, threads, jobs}).status().code(), ErrorCode::budget_exceeded);
          for (std::uint64_t share = least; share < gibibytes(64); share += 1 + share / 5) {
            const auto plan = plan_budget(*store, {share, threads, jobs});
            ASSERT_TRUE(plan) << plan.status().message();
            const std::string where = std::to_string(share) + " bytes, " + std::to_string(threads) + " threads, " +
                                      std::to_string(jobs) + " jobs, pages of " + std::to_string(page_bytes) + ", " +
                                      std::to_string(store->page_count()) + " pages";
            ASSERT_LE(claimed_bytes(*store, *plan, jobs), share) << where;
            EXPECT_GE(plan->read_depth, 1u) << where;
            EXPECT_GE(plan->frame_count, std::min(store->page_count(), threads + plan->read_depth)) << where;
            EXPECT_LE(plan->frame_count, store->page_count()) << where;
          }
        }
      }
    }
  }
}

TEST_F(BudgetPlanTest, TheLeastHoldsWhateverAJobAnswers) {
  const auto store = open(20000, 16 << 10, "zstd");
  const std::uint64_t least = least_share_bytes(*store, 2, 3);
  const auto plan = plan_budget(*store, {least, 2, 3});
  ASSERT_TRUE(plan) << plan.status().message();
  for (std::uint32_t fields = 1; fields <= std::uint32_t(Field::all | Field::count); ++fields) {
    for (const bool lists : {false, true}) {
      const JobPlan job = plan_job(*plan, store->page_count(), {.fields = Field(fields), .lists = lists});
      EXPECT_LE(claimed_beside_jobs(*store, *plan) + 3 * job_bytes(job), least)
          << to_string(Field(fields)) << (lists ? ", lists" : "");
    }
  }
}

TEST_F(BudgetPlanTest, RefusalNamesTheLeast) {
  const auto store = open(1000, 16 << 10, "zstd");
  const std::uint64_t least = least_share_bytes(*store, 2, 1);
  const Status status = plan_budget(*store, {least / 2, 2, 1}).status();
  EXPECT_NE(status.message().find(storage::format_bytes(least)), std::string::npos) << status.message();
}

TEST_F(BudgetPlanTest, PlentyHoldsTheWholeStore) {
  const auto store = open(20000, 16 << 10, "zstd");
  EXPECT_EQ(plan_budget(*store, {gibibytes(4), 2, 1})->frame_count, store->page_count());
}

TEST(JobPlan, GrowsWithItsBytesAndNeverPassesThem) {
  BudgetPlan plan;
  plan.group_pages = 10;
  plan.extent_bytes = 64 << 10;
  for (const RowsAsked& rows : {RowsAsked{Field::t}, {Field::all}, {Field::t, true}, {Field::all, true}}) {
    std::uint64_t last = 0;
    for (plan.job_bytes = mebibytes(2); plan.job_bytes < gibibytes(8); plan.job_bytes += plan.job_bytes / 3) {
      const JobPlan job = plan_job(plan, 1000, rows);
      EXPECT_LE(job_bytes(job), plan.job_bytes);
      EXPECT_GE(job.waiting.pool_chunks, last) << "more memory, not fewer rays";
      EXPECT_GE(job.window.blocks, ResultWindow::kMinBlocks);
      EXPECT_LE(std::uint64_t(job.window.slots) << job.window.chunk_shift, std::uint64_t(1) << 32);
      EXPECT_GE(std::uint64_t(job.window.slots) << job.window.chunk_shift, job.most_in_flight);
      EXPECT_LE(job.most_in_flight, std::uint64_t(job.window.blocks) << job.window.chunk_shift)
          << "each chunk under way has a block";
      EXPECT_GE(job.most_in_flight, 10000u);
      last = job.waiting.pool_chunks;
    }
  }
}

}  // namespace
}  // namespace raymill::traversal
