// Submitted jobs: they go on without their client, and any client may ask for them.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>

#include "server/limits.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

Result<std::string> submit(Client& client, const std::string& store, std::size_t count) {
  std::uint64_t sent = 0;
  return client.submit(store, {}, [&, count](std::span<Ray> room) -> Result<std::size_t> {
    const std::size_t batch = std::min({room.size(), std::size_t{3000}, count - sent});
    const auto rays = numbered_rays(sent, batch);
    std::copy(rays.begin(), rays.end(), room.begin());
    sent += batch;
    return batch;
  });
}

/// Fetches all rows and checks them.
Status fetch_and_check(Client& client, const std::string& id, std::size_t count, std::uint32_t store_bytes) {
  std::vector<std::byte> bytes;
  HitLayout layout;
  std::uint64_t total = 0;
  RAYMILL_RETURN_IF_ERROR(client.fetch(
      id,
      [&](const HitLayout& its_layout, std::uint64_t total_rays) {
        layout = its_layout;
        total = total_rays;
        return Status();
      },
      [&](std::span<const std::byte> rows) {
        bytes.insert(bytes.end(), rows.begin(), rows.end());
        return Status();
      }));
  EXPECT_EQ(total, count);
  EXPECT_EQ(bytes.size(), count * layout.row_bytes());
  for (std::size_t i = 0; i < count && bytes.size() == count * layout.row_bytes(); ++i) {
    const Hit hit = layout.read(bytes.data() + i * layout.row_bytes());
    if (hit.t != expected_hit(i, store_bytes).t || hit.geometry_id != store_bytes) {
      return {ErrorCode::internal, "row " + std::to_string(i) + " is another one"};
    }
  }
  return {};
}

std::size_t spooled_files(const Harness& harness) {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(harness.config().spool_directory)) {
    files += entry.path().string().ends_with(".rows") || entry.path().string().ends_with(".part") ? 1 : 0;
  }
  return files;
}

TEST(ServerSubmit, ResultsOutliveTheClientAndAreFetchedByAnother) {
  Harness harness;
  constexpr std::size_t kCount = 100'003;
  std::string id;
  {
    const auto client = harness.client();
    auto submitted = submit(*client, "city", kCount);
    ASSERT_TRUE(submitted.ok()) << submitted.status().message();
    id = *submitted;
  }
  const auto other = harness.client();
  const auto done = other->wait(id, 10);
  ASSERT_TRUE(done.ok()) << done.status().message();
  EXPECT_EQ(done->state, JobState::done) << done->message;
  EXPECT_EQ(done->rays, kCount);
  EXPECT_EQ(done->rays_done, kCount);
  EXPECT_EQ(done->store, "city");
  EXPECT_TRUE(done->detached);
  const auto jobs = other->jobs();
  ASSERT_TRUE(jobs.ok());
  ASSERT_EQ(jobs->size(), 1u);
  EXPECT_EQ(jobs->front().id, id);
  for (int times = 0; times < 2; ++times) {
    const Status fetched = fetch_and_check(*other, id, kCount, kCityBytes);
    EXPECT_TRUE(fetched.ok()) << fetched.message();
  }
  EXPECT_EQ(spooled_files(harness), 1u);
  EXPECT_TRUE(other->cancel(id).ok());
  EXPECT_EQ(spooled_files(harness), 0u);
  EXPECT_EQ(other->job(id).status().code(), ErrorCode::not_found);
  EXPECT_EQ(other->fetch(id, {}, {}).code(), ErrorCode::not_found);
}

TEST(ServerSubmit, AJobWithoutRaysIsDoneAndEmpty) {
  Harness harness;
  const auto client = harness.client();
  const auto id = submit(*client, "town", 0);
  ASSERT_TRUE(id.ok());
  ASSERT_TRUE(client->wait(*id, 10).ok());
  EXPECT_TRUE(fetch_and_check(*client, *id, 0, kTownBytes).ok());
}

TEST(ServerSubmit, CancelStopsARunningJobAndWaitersLearnIt) {
  Harness harness;
  const auto client = harness.client();
  harness.fake().hold(true);
  const auto id = submit(*client, "city", 10'000);
  ASSERT_TRUE(id.ok());
  EXPECT_EQ(client->wait(*id, 0.05).status().code(), ErrorCode::busy_retry);
  EXPECT_EQ(client->fetch(*id, {}, {}).code(), ErrorCode::busy_retry);
  ASSERT_TRUE(client->cancel(*id).ok());
  const auto info = client->wait(*id, 10);
  ASSERT_TRUE(info.ok());
  EXPECT_EQ(info->state, JobState::cancelled);
  EXPECT_EQ(client->fetch(*id, {}, {}).code(), ErrorCode::cancelled);
  EXPECT_TRUE(eventually([&] { return harness.fake().live_jobs == 0; }));
  EXPECT_EQ(spooled_files(harness), 0u);
  ASSERT_TRUE(client->cancel(*id).ok());
  EXPECT_EQ(client->job(*id).status().code(), ErrorCode::not_found);
}

TEST(ServerSubmit, AFailedJobSaysWhy) {
  Harness harness;
  const auto client = harness.client();
  harness.fake().hold(true);  // or the failure may come before all rays are sent
  const auto id = submit(*client, "failing", 6000);
  ASSERT_TRUE(id.ok()) << id.status().message();
  harness.fake().hold(false);
  const auto info = client->wait(*id, 10);
  ASSERT_TRUE(info.ok());
  EXPECT_EQ(info->state, JobState::failed);
  EXPECT_EQ(info->message, "the disk of the fake store failed");
  EXPECT_EQ(client->fetch(*id, {}, {}).code(), ErrorCode::io);
}

TEST(ServerSubmit, AJobThatFailsWhileItsRaysAreSentEndsTheSubmission) {
  Harness harness;
  const auto client = harness.client();
  const auto id = submit(*client, "failing", 100'000'000);
  EXPECT_EQ(id.status().code(), ErrorCode::io);
  EXPECT_EQ(id.status().message(), "the disk of the fake store failed");
}

TEST(ServerSubmit, AFailingSourceOfRaysLeavesNothingBehind) {
  Harness harness;
  const auto client = harness.client();
  const auto id = client->submit(
      "city", {}, [](std::span<Ray>) -> Result<std::size_t> { return Status(ErrorCode::bad_rays, "no rays"); });
  EXPECT_EQ(id.status().code(), ErrorCode::bad_rays);
  EXPECT_TRUE(eventually([&] { return harness.stats().jobs_known == 0; }));
  EXPECT_EQ(spooled_files(harness), 0u);
}

TEST(ServerSubmit, AttachedJobsAreListedButNotFetchedOrCancelledByOthers) {
  Harness harness;
  const auto client = harness.client();
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok());
  const auto other = harness.client();
  const auto jobs = other->jobs();
  ASSERT_TRUE(jobs.ok());
  ASSERT_EQ(jobs->size(), 1u);
  EXPECT_FALSE(jobs->front().detached);
  const std::string id = jobs->front().id;
  EXPECT_EQ(other->cancel(id).code(), ErrorCode::unauthorised);
  EXPECT_EQ(other->fetch(id, {}, {}).code(), ErrorCode::invalid_argument);
  ASSERT_TRUE((*job)->finish().ok());
  EXPECT_TRUE(read_and_check(**job, 0, 0, kCityBytes).ok());
}

}  // namespace
}  // namespace raymill::server
