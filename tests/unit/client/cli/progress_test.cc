#include "client/cli/progress.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace raymill::client {
namespace {

constexpr ProgressState kState{.phase = "trace",
                               .fraction = 0.4279,
                               .done = 3000000,
                               .unit = "rays",
                               .elapsed_seconds = 2,
                               .paged_bytes = 3 << 20};

TEST(Progress, FarmLinesAreWhatTheFarmsRead) {
  EXPECT_EQ(format_progress(ProgressStyle::alf, kState), "ALF_PROGRESS 42%");
  EXPECT_EQ(format_progress(ProgressStyle::openjd, kState), "openjd_progress: 42.7");
  EXPECT_EQ(format_progress(ProgressStyle::alf, {.phase = "trace", .fraction = 1}), "ALF_PROGRESS 100%");
  EXPECT_EQ(format_progress(ProgressStyle::openjd, {.phase = "trace", .fraction = 1}), "openjd_progress: 100.0");
  EXPECT_EQ(format_progress(ProgressStyle::none, kState), "");
}

TEST(Progress, JsonLineParses) {
  const auto object = nlohmann::json::parse(format_progress(ProgressStyle::json, kState));
  EXPECT_EQ(object["phase"], "trace");
  EXPECT_NEAR(object["progress"].get<double>(), 0.4279, 1e-4);
  EXPECT_EQ(object["rays_done"], 3000000);
  EXPECT_NEAR(object["rays_per_second"].get<double>(), 1.5e6, 1);
  EXPECT_NEAR(object["seconds_left"].get<double>(), 2.7, 0.1);
  EXPECT_EQ(object["paged_bytes"], 3 << 20);
  EXPECT_FALSE(nlohmann::json::parse(format_progress(ProgressStyle::json, {.phase = "build"})).contains("rays_done"));
}

TEST(Progress, BarSaysRateBytesPagedAndTimeLeft) {
  const std::string text = format_progress(ProgressStyle::bar, kState);
  EXPECT_NE(text.find("42%"), std::string::npos) << text;
  EXPECT_NE(text.find("1.50 Mrays/s"), std::string::npos) << text;
  EXPECT_NE(text.find("0:03 left"), std::string::npos) << text;
  EXPECT_NE(text.find("3.0 MiB paged"), std::string::npos) << text;
}

TEST(Progress, StylesByName) {
  EXPECT_EQ(*parse_progress_style("alf"), ProgressStyle::alf);
  EXPECT_EQ(*parse_progress_style("none"), ProgressStyle::none);
  EXPECT_EQ(parse_progress_style("loud").status().code(), ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace raymill::client
