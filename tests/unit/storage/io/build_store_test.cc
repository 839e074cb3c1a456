#include "storage/io/build_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/support/stores.h"

namespace raymill {
namespace {

using tests::Random;
using tests::Scene;
using tests::TempFolder;

Scene some_scene() {
  Random random(1);
  return {tests::soup(random, 4000), tests::grid(30, 0.1F), tests::coincident(50)};
}

class EveryLayout : public testing::TestWithParam<std::tuple<unsigned, const char*, const char*>> {
 protected:
  static BuildConfig config() {
    BuildConfig config = tests::small_pages();
    config.width = std::get<0>(GetParam());
    config.codec = std::get<1>(GetParam());
    config.positions = std::get<2>(GetParam());
    return config;
  }
};

TEST_P(EveryLayout, VerifiesAndIsTheSameForEveryNumberOfThreads) {
  const TempFolder folder;
  std::string first;
  for (const unsigned threads : {1u, 2u, 4u}) {
    BuildConfig layout = config();
    layout.threads = threads;
    const std::string path = tests::build_store(folder, "scene.mill", some_scene(), layout);
    const auto verified = verify(path);
    ASSERT_TRUE(verified) << verified.status().message();
    EXPECT_EQ(verified->triangles, 4000u + 1800 + 50);
    const std::string bytes = tests::read_file(path);
    first = first.empty() ? bytes : first;
    EXPECT_EQ(bytes == first, true) << threads << " threads";
  }
}

INSTANTIATE_TEST_SUITE_P(Layouts, EveryLayout,
                         testing::Combine(testing::Values(4u, 8u), testing::Values("raw", "lz4", "zstd"),
                                          testing::Values("float32", "lattice:16b")));
INSTANTIATE_TEST_SUITE_P(Draco, EveryLayout,
                         testing::Combine(testing::Values(4u, 8u), testing::Values("draco"),
                                          testing::Values("lattice:16b", "lattice:0.001")));

TEST(Build, SameSceneUnderAnotherNameGivesAnotherMetadataOnly) {
  const TempFolder folder;
  const std::string a = tests::read_file(tests::build_store(folder, "a.mill", some_scene()));
  const std::string b = tests::read_file(tests::build_store(folder, "a.mill", some_scene()));
  EXPECT_EQ(a == b, true) << "building again changes nothing";
}

TEST(Build, ConfigsThatCannotBeAreRefused) {
  const TempFolder folder;
  const auto code = [&](auto&& change) {
    BuildConfig config = tests::small_pages();
    tests::write_file(folder / "in.glb", tests::glb({tests::grid(2)}));
    config.scenes = {folder / "in.glb"};
    config.output = folder / "out.mill";
    change(config);
    const auto report = build(config);
    return report.status().code();
  };
  EXPECT_EQ(code([](BuildConfig&) {}), ErrorCode::ok);
  EXPECT_EQ(code([](BuildConfig& c) { c.scenes.clear(); }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.output.clear(); }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.width = 2; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.page_bytes = 1000; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.page_bytes = 2 << 20; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.codec = "rar"; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.codec = "draco"; }), ErrorCode::invalid_argument) << "needs a lattice";
  EXPECT_EQ(code([](BuildConfig& c) { c.positions = "lattice:1e-9"; }), ErrorCode::ok);
  EXPECT_EQ(code([](BuildConfig& c) { c.positions = "lattice:1e-12"; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.memory = mebibytes(1); }), ErrorCode::budget_exceeded);
  EXPECT_EQ(code([&](BuildConfig& c) { c.scenes = {folder / "none.glb"}; }), ErrorCode::not_found);
  EXPECT_EQ(code([&](BuildConfig& c) { c.output = folder / "none/out.mill"; }), ErrorCode::not_found);
  EXPECT_EQ(code([&](BuildConfig& c) { c.output = folder.path(); }), ErrorCode::invalid_argument);
}

TEST(Build, SceneOfNothingButDegenerateTrianglesIsABadScene) {
  const TempFolder folder;
  tests::write_file(folder / "in.glb", tests::glb({{{tests::Vec3f{1, 1, 1}, {1, 1, 1}, {2, 2, 2}}}}));
  BuildConfig config = tests::small_pages();
  config.scenes = {folder / "in.glb"};
  config.output = folder / "out.mill";
  const auto report = build(config);
  EXPECT_EQ(report.status().code(), ErrorCode::bad_scene) << report.status().message();
  EXPECT_EQ(folder.files(), 1u);
}

TEST(Build, StoppedBuildLeavesTheOldStoreAndNothingElse) {
  const TempFolder folder;
  const std::string path = tests::build_store(folder, "scene.mill", {tests::grid(3)});
  const std::string before = tests::read_file(path);
  const std::size_t files = folder.files();
  for (const std::string stop_at : {"import", "partition", "build"}) {
    BuildConfig config = tests::small_pages();
    config.scenes = {folder / "scene.mill.glb"};
    config.output = path;
    config.progress = [&](const char* phase, double) { return phase != stop_at; };
    EXPECT_EQ(build(config).status().code(), ErrorCode::interrupted) << stop_at;
    EXPECT_EQ(tests::read_file(path) == before, true);
    EXPECT_EQ(folder.files(), files);
  }
}

TEST(Build, ProgressRisesThroughItsPhases) {
  const TempFolder folder;
  tests::write_file(folder / "in.glb", tests::glb(some_scene()));
  BuildConfig config = tests::small_pages();
  config.scenes = {folder / "in.glb"};
  config.output = folder / "out.mill";
  std::vector<std::string> phases;
  double last = 0;
  config.progress = [&](const std::string& phase, double fraction) {
    if (phases.empty() || phases.back() != phase) {
      phases.push_back(phase);
      last = 0;
    }
    EXPECT_GE(fraction, last);
    EXPECT_LE(fraction, 1);
    last = fraction;
    return true;
  };
  ASSERT_TRUE(build(config));
  EXPECT_EQ(phases, (std::vector<std::string>{"import", "partition", "build"}));
}

TEST(Build, SeveralFilesNumberTheirGeometriesOn) {
  const TempFolder folder;
  tests::write_file(folder / "a.glb", tests::glb({tests::grid(1), tests::grid(2)}));
  tests::write_file(folder / "b.glb", tests::glb({tests::moved(tests::grid(1), {0, 0, 5})}));
  BuildConfig config = tests::small_pages();
  config.scenes = {folder / "a.glb", folder / "b.glb"};
  config.output = folder / "out.mill";
  const auto report = build(config);
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_EQ(report->triangles, 2u + 8 + 2);
  const Ray up = [] {
    Ray ray;
    ray.org = {0.75F, 0.25F, 4};
    ray.dir = {0, 0, 1};
    return ray;
  }();
  const auto traced = tests::trace(config.output, {{up}});
  ASSERT_EQ(traced.hits.size(), 1u);
  EXPECT_EQ(traced.hits[0].geometry_id, 2u);
}

TEST(Inspect, ShowsNodesAndTrianglesOfAPage) {
  const TempFolder folder;
  const std::string path = tests::build_store(folder, "scene.mill", {tests::grid(1)});
  const auto text = inspect_page(path, 0);
  ASSERT_TRUE(text);
  const auto json = nlohmann::json::parse(*text);
  EXPECT_EQ(json["triangles"], 2);
  EXPECT_EQ(json["checksum"], "ok");
  EXPECT_EQ(json["codec"], "zstd");
  EXPECT_EQ(json["triangle_list"].size(), 2u);
  EXPECT_EQ(inspect_page(path, 1).status().code(), ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace raymill
