#include "traversal/timeline.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "tests/support/stores.h"
#include "tests/support/temp_folder.h"

namespace raymill {
namespace {

using nlohmann::json;

TEST(Timeline, IsJsonThatPerfettoReadsWhateverTheThreads) {
  const tests::TempFolder folder;
  const auto timeline = *Timeline::create(folder / "run.json");
  constexpr unsigned kThreads = 4, kSpans = 2000;
  std::vector<std::thread> threads;
  for (unsigned lane = 0; lane < kThreads; ++lane) {
    threads.emplace_back([&, lane] {
      timeline->name_lane(lane, "worker " + std::to_string(lane));
      for (unsigned i = 0; i < kSpans; ++i) {
        const auto begin = Timeline::Clock::now();
        timeline->span(lane, "rays", begin, "rays", i);
      }
      timeline->read(lane, Timeline::Clock::now(), Timeline::Clock::now(), 4096);
      timeline->counter("in flight", lane);
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  ASSERT_TRUE(timeline->finish().ok());
  timeline->counter("too late", 1);
  const json events = json::parse(tests::read_file(folder / "run.json")).at("traceEvents");
  std::map<std::string, unsigned> count;
  for (const json& event : events) {
    ++count[event.at("ph").get<std::string>()];
    if (event.at("ph") == "X") {
      EXPECT_GE(event.at("dur").get<double>(), 0);
      EXPECT_GE(event.at("ts").get<double>(), 0);
    }
  }
  EXPECT_EQ(count["X"], kThreads * kSpans);
  EXPECT_EQ(count["M"], kThreads);
  EXPECT_EQ(count["b"], kThreads);
  EXPECT_EQ(count["e"], kThreads);
  EXPECT_EQ(count["C"], kThreads);
}

TEST(Timeline, WithoutFinishThereIsNoFile) {
  const tests::TempFolder folder;
  {
    const auto timeline = *Timeline::create(folder / "run.json");
    timeline->counter("in flight", 1);
  }
  EXPECT_EQ(folder.files(), 0u);
  const auto empty = *Timeline::create(folder / "empty.json");
  ASSERT_TRUE(empty->finish().ok());
  EXPECT_TRUE(json::parse(tests::read_file(folder / "empty.json")).at("traceEvents").empty());
}

}  // namespace
}  // namespace raymill
