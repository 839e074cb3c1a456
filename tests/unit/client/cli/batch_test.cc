#include "client/cli/batch.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <mutex>
#include <vector>

namespace raymill::client {
namespace {

// Answers each ray with its org.x, in chunks of up to 100 rows; keeps at most 1000 rays, so push() waits for next().
class EchoJob final : public Job {
 public:
  explicit EchoJob(std::uint64_t fail_after = ~std::uint64_t{0}) : fail_after_(fail_after) {}

  Status push(std::span<const Ray> rays) override {
    for (const Ray& ray : rays) {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return values_.size() - taken_ < 1000 || !error_.ok(); });
      if (!error_.ok()) {
        return error_;
      }
      values_.push_back(ray.org[0]);
      if (values_.size() >= fail_after_) {
        error_ = Status(ErrorCode::io, "the disk is gone");
      }
      changed_.notify_all();
    }
    return {};
  }
  Status finish() override {
    const std::lock_guard lock(mutex_);
    finished_ = true;
    changed_.notify_all();
    return {};
  }
  std::optional<HitChunk> next() override {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return taken_ < values_.size() || finished_ || !error_.ok(); });
    if (!error_.ok() || taken_ == values_.size()) {
      return std::nullopt;
    }
    const std::size_t count = std::min<std::size_t>(100, values_.size() - taken_);
    chunk_.assign(values_.begin() + static_cast<std::ptrdiff_t>(taken_),
                  values_.begin() + static_cast<std::ptrdiff_t>(taken_ + count));
    HitChunk chunk(index_++, taken_, HitLayout(), std::as_bytes(std::span(chunk_)), nullptr);
    taken_ += count;
    changed_.notify_all();
    return chunk;
  }
  Status status() const override {
    const std::lock_guard lock(mutex_);
    return error_;
  }
  JobProgress progress() const override {
    const std::lock_guard lock(mutex_);
    return {.rays_pushed = values_.size(), .rays_done = taken_};
  }
  JobStats stats() const override { return {}; }
  void cancel() override {
    const std::lock_guard lock(mutex_);
    if (error_.ok()) {
      error_ = Status(ErrorCode::cancelled, "cancelled");
    }
    changed_.notify_all();
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<float> values_, chunk_;
  std::size_t taken_ = 0;
  std::uint64_t index_ = 0;
  std::uint64_t fail_after_;
  bool finished_ = false;
  Status error_;
};

std::vector<Ray> numbered(std::size_t count) {
  std::vector<Ray> rays(count);
  for (std::size_t i = 0; i < count; ++i) {
    rays[i].org[0] = static_cast<float>(i);
  }
  return rays;
}

HitSink collect(std::vector<float>& values) {
  return [&values](const HitChunk& chunk) -> Status {
    const auto* rows = reinterpret_cast<const float*>(chunk.rows().data());
    values.insert(values.end(), rows, rows + chunk.rows().size() / sizeof(float));
    return {};
  };
}

TEST(RunBatch, EveryRayIsAnsweredInOrder) {
  EchoJob job;
  const auto rays = numbered(50000);
  std::vector<float> values;
  JobProgress last;
  BatchTimes times;
  const Status status = run_batch(
      job, source_of(rays), collect(values), [&](const JobProgress& p) { last = p; }, times);
  ASSERT_TRUE(status.ok()) << status.message();
  ASSERT_EQ(values.size(), rays.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    ASSERT_EQ(values[i], static_cast<float>(i));
  }
  EXPECT_EQ(last.rays_done, rays.size());
}

TEST(RunBatch, NoRaysAreFine) {
  EchoJob job;
  std::vector<float> values;
  BatchTimes times;
  EXPECT_TRUE(run_batch(job, source_of({}), collect(values), nullptr, times).ok());
  EXPECT_TRUE(values.empty());
}

TEST(RunBatch, ErrorOfTheSourceEndsTheJob) {
  EchoJob job;
  const auto rays = numbered(5000);
  std::vector<float> values;
  BatchTimes times;
  int calls = 0;
  const RaySource source = [&]() -> Result<std::span<const Ray>> {
    if (++calls == 2) {
      return Status(ErrorCode::bad_rays, "the file became shorter");
    }
    return std::span<const Ray>(rays);
  };
  EXPECT_EQ(run_batch(job, source, collect(values), nullptr, times).code(), ErrorCode::bad_rays);
  EXPECT_EQ(job.status().code(), ErrorCode::cancelled);
}

TEST(RunBatch, ErrorOfTheSinkEndsTheJob) {
  EchoJob job;
  const auto rays = numbered(50000);
  BatchTimes times;
  const HitSink sink = [](const HitChunk& chunk) {
    return chunk.index() == 3 ? Status(ErrorCode::disk_full, "no space") : Status();
  };
  EXPECT_EQ(run_batch(job, source_of(rays), sink, nullptr, times).code(), ErrorCode::disk_full);
}

TEST(RunBatch, ErrorOfTheJobIsHandedOn) {
  EchoJob job(3000);
  const auto rays = numbered(50000);
  std::vector<float> values;
  BatchTimes times;
  EXPECT_EQ(run_batch(job, source_of(rays), collect(values), nullptr, times).code(), ErrorCode::io);
}

TEST(RunStats, AddsJobsAndKeepsTheStoresCounters) {
  RunStats stats;
  JobStats first, second;
  first.rays = 10;
  first.pages_read = 5;
  first.trace_seconds = 1;
  second.rays = 20;
  second.pages_read = 7;
  second.trace_seconds = 2;
  second.isa = "avx2";
  stats.add(first);
  stats.add(second);
  EXPECT_EQ(stats.total().rays, 30U);
  EXPECT_EQ(stats.total().pages_read, 7U);
  EXPECT_EQ(stats.total().trace_seconds, 3);
  EXPECT_EQ(stats.total().isa, "avx2");
}

}  // namespace
}  // namespace raymill::client
