// Attached jobs through a server: the same rows as from the tracer itself, whatever the other clients do.
#include <gtest/gtest.h>

#include <thread>

#include "server/limits.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

TEST(ServerTrace, AnswersRaysInTheirOrder) {
  Harness harness;
  const auto client = harness.client();
  const auto store = client->open("city");
  ASSERT_TRUE(store.ok()) << store.status().message();
  EXPECT_TRUE(trace_and_check(**store, 0, 50'001, kCityBytes).ok());
  EXPECT_TRUE(trace_and_check(**store, 100, 1, kCityBytes).ok());
  EXPECT_TRUE(trace_and_check(**store, 0, 0, kCityBytes).ok());
}

TEST(ServerTrace, ServesOverLoopbackTcp) {
  Harness harness([](ServeConfig& config) { config.bind = "tcp://127.0.0.1:0"; });
  EXPECT_TRUE(harness.endpoint().starts_with("tcp://127.0.0.1:"));
  EXPECT_FALSE(harness.endpoint().ends_with(":0"));
  const auto client = harness.client();
  const auto store = client->open("city.mill");
  ASSERT_TRUE(store.ok()) << store.status().message();
  EXPECT_TRUE(trace_and_check(**store, 0, 20'000, kCityBytes).ok());
}

TEST(ServerTrace, PushingEverythingBeforeTheFirstNextDoesNotBlock) {
  Harness harness;
  const auto client = harness.client();
  const auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  // Many times what the windows of both directions hold.
  const std::size_t count = 20 * (kChunkWindow + kRowsWindow) * kLeastChunkRays;
  auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok());
  ASSERT_TRUE((*job)->push(numbered_rays(0, count)).ok());
  ASSERT_TRUE((*job)->finish().ok());
  // Everything is traced, but the server holds no more rows for the client than it accepted.
  EXPECT_TRUE(eventually([&] { return harness.fake().rays_traced == count; }));
  EXPECT_LE(harness.fake().held_chunks, 1u);
  EXPECT_TRUE(read_and_check(**job, 0, count, kCityBytes).ok());
  EXPECT_EQ((*job)->stats().rays, count);
  EXPECT_EQ((*job)->stats().kernel, "fake");
  EXPECT_EQ((*job)->progress().rays_done, count);
}

TEST(ServerTrace, CancellingOneClientHalfwayLeavesTheOtherAlone) {
  Harness harness;
  const auto first = harness.client();
  const auto second = harness.client();
  auto city = first->open("city");
  auto town = second->open("town");
  ASSERT_TRUE(city.ok() && town.ok());
  Status other;
  std::thread thread([&] { other = trace_and_check(**town, 7, 300'000, kTownBytes); });
  auto job = (*city)->trace({});
  ASSERT_TRUE(job.ok());
  ASSERT_TRUE((*job)->push(numbered_rays(0, 100'000)).ok());
  ASSERT_TRUE((*job)->next().has_value());
  (*job)->cancel();
  EXPECT_FALSE((*job)->next().has_value());
  EXPECT_EQ((*job)->status().code(), ErrorCode::cancelled);
  EXPECT_EQ((*job)->push(numbered_rays(0, 100'000)).code(), ErrorCode::cancelled);
  thread.join();
  EXPECT_TRUE(other.ok()) << other.message();
  EXPECT_TRUE(eventually([&] { return harness.fake().live_jobs == 0; }));
  EXPECT_TRUE(trace_and_check(**city, 3, 10'000, kCityBytes).ok());
}

TEST(ServerTrace, ManyClientsShareStoresAndWaitTheirTurn) {
  Harness harness([](ServeConfig& config) {
    config.max_jobs = 2;
    config.max_stores = 1;
  });
  std::vector<std::thread> threads;
  for (int i = 0; i < 6; ++i) {
    threads.emplace_back([&harness, i] {
      const auto client = harness.client();
      const bool city = i % 2 == 0;
      auto store = client->open(city ? "city" : "town");
      ASSERT_TRUE(store.ok()) << store.status().message();
      const Status status =
          trace_and_check(**store, static_cast<std::uint64_t>(i), 30'000, city ? kCityBytes : kTownBytes);
      EXPECT_TRUE(status.ok()) << status.message();
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(harness.fake().most_open_stores, 1);
}

TEST(ServerTrace, AnyHitRowsHoldTimeOnly) {
  Harness harness;
  const auto client = harness.client();
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  auto job = (*store)->trace({.query = Query::any, .mode = Mode::fast});
  ASSERT_TRUE(job.ok());
  ASSERT_TRUE((*job)->push(numbered_rays(0, 10)).ok());
  ASSERT_TRUE((*job)->finish().ok());
  const auto chunk = (*job)->next();
  ASSERT_TRUE(chunk.has_value());
  EXPECT_EQ(chunk->layout().row_bytes(), 4u);
  EXPECT_EQ(chunk->hit(9).t, 19.0f);
}

TEST(ServerTrace, AnErrorOfTheTracerReachesAClientThatOnlyPushes) {
  Harness harness;
  const auto client = harness.client();
  auto store = client->open("failing");
  ASSERT_TRUE(store.ok());
  auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok());
  Status status;
  for (int i = 0; i < 1000 && status.ok(); ++i) {
    status = (*job)->push(numbered_rays(0, 50'000));
  }
  EXPECT_EQ(status.code(), ErrorCode::io);
  EXPECT_EQ(status.message(), "the disk of the fake store failed");
  EXPECT_FALSE((*job)->next().has_value());
  EXPECT_EQ((*job)->status().code(), ErrorCode::io);
}

TEST(ServerStores, AreDescribedListedAndRefused) {
  Harness harness;
  harness.folder().write("stores/maps/deep.mill", "deep");
  const auto client = harness.client();
  const auto names = client->stores();
  ASSERT_TRUE(names.ok());
  EXPECT_EQ(*names, (std::vector<std::string>{"city", "corrupt", "failing", "maps/deep", "town"}));
  auto store = client->open("town");
  ASSERT_TRUE(store.ok());
  const auto info = (*store)->info();
  ASSERT_TRUE(info.ok()) << info.status().message();
  EXPECT_EQ(info->name, "town");
  EXPECT_EQ(info->triangles, kTownBytes);
  EXPECT_EQ(info->bounds_max[2], 3.0f);
  EXPECT_EQ(info->metadata_json, R"({"geometries":[]})");
  EXPECT_EQ(client->open("village").status().code(), ErrorCode::not_found);
  EXPECT_EQ(client->open("corrupt").status().code(), ErrorCode::corrupt);
  EXPECT_EQ(client->open("../stores/city").status().code(), ErrorCode::invalid_argument);
}

TEST(ServerStores, IdleOnesAreClosed) {
  Harness harness([](ServeConfig& config) { config.idle_seconds = 0.2; });
  const auto client = harness.client();
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  EXPECT_TRUE(trace_and_check(**store, 0, 1000, kCityBytes).ok());
  EXPECT_TRUE(eventually([&] { return harness.fake().open_stores == 0; }));
  // The client's store is as good as before: the server opens its own again.
  EXPECT_TRUE(trace_and_check(**store, 0, 1000, kCityBytes).ok());
  EXPECT_GE(harness.fake().opens, 2);
}

TEST(ServerStores, AnIdleOneMakesRoomForAnother) {
  Harness harness([](ServeConfig& config) { config.max_stores = 1; });
  const auto client = harness.client();
  auto city = client->open("city");
  auto town = client->open("town");
  ASSERT_TRUE(city.ok() && town.ok());
  EXPECT_TRUE(trace_and_check(**city, 0, 1000, kCityBytes).ok());
  EXPECT_TRUE(trace_and_check(**town, 0, 1000, kTownBytes).ok());
  EXPECT_EQ(harness.fake().most_open_stores, 1);
}

TEST(ServerStores, OpeningDoesNotWaitForABusySlot) {
  Harness harness([](ServeConfig& config) { config.max_stores = 1; });
  const auto client = harness.client();
  auto city = client->open("city");
  ASSERT_TRUE(city.ok());
  harness.fake().hold(true);
  auto job = (*city)->trace({});
  ASSERT_TRUE(job.ok());
  ASSERT_TRUE((*job)->push(numbered_rays(0, 10'000)).ok());
  auto town = client->open("town");
  ASSERT_TRUE(town.ok()) << town.status().message();
  EXPECT_EQ((*town)->info().status().code(), ErrorCode::busy_retry);
  EXPECT_EQ(client->open("village").status().code(), ErrorCode::not_found);
  auto waiting = (*town)->trace({});
  ASSERT_TRUE(waiting.ok());
  harness.fake().hold(false);
  ASSERT_TRUE((*job)->finish().ok());
  EXPECT_TRUE(read_and_check(**job, 0, 10'000, kCityBytes).ok());
  ASSERT_TRUE((*waiting)->push(numbered_rays(0, 10)).ok());
  ASSERT_TRUE((*waiting)->finish().ok());
  EXPECT_TRUE(read_and_check(**waiting, 0, 10, kTownBytes).ok());
}

}  // namespace
}  // namespace raymill::server
