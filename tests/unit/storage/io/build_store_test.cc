#include "storage/io/build_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "storage/io/store_costs.h"
#include "storage/io/store_file.h"
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

// A store of two triangles, placed so often.
std::string build_placed(const TempFolder& folder, int times) {
  BuildConfig config = tests::small_pages();
  config.output = folder / "placed.mill";
  auto writer = StoreWriter::create(config);
  EXPECT_TRUE(writer.ok()) << writer.status().message();
  const std::vector<float> positions = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
  const std::vector<std::uint32_t> indices = {0, 1, 2, 0, 2, 3};
  const MeshView mesh{.name = "tile", .positions = positions, .indices = indices};
  const auto object = writer->add_object({&mesh, 1});
  EXPECT_TRUE(object.ok()) << object.status().message();
  std::array<double, 16> matrix = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  for (int i = 0; i < times; ++i) {
    matrix[12] = 2 * i;
    EXPECT_TRUE(writer->place(*object, matrix).ok());
  }
  const auto report = writer->finish();
  EXPECT_TRUE(report.ok()) << report.status().message();
  return config.output;
}

TEST(Costs, OfFeaturesAddUpToTheStore) {
  const TempFolder folder;
  BuildConfig lattice = tests::small_pages();
  lattice.positions = "lattice:0.001";
  const std::vector<std::pair<std::string, std::vector<std::string>>> stores = {
      {tests::build_store(folder, "one.mill", {tests::grid(9)}), {"triangles", "file"}},
      {tests::build_store(folder, "three.mill", some_scene(), lattice),
       {"triangles", "geometry_ids", "lattice", "file"}},
      {build_placed(folder, 700), {"triangles", "geometry_ids", "instances", "file"}}};
  for (const auto& [path, features] : stores) {
    const auto costs = store_costs(path);
    ASSERT_TRUE(costs.ok()) << costs.status().message();
    storage::Ledger ledger(gibibytes(1));
    const auto file = storage::StoreFile::open(path, ledger);
    ASSERT_TRUE(file.ok());
    std::vector<std::string> names;
    std::uint64_t pages = 0, store_bytes = 0, decoded_bytes = 0;
    for (const FeatureCost& cost : *costs) {
      names.push_back(cost.feature);
      pages += cost.pages;
      store_bytes += cost.store_bytes.value_or(0);
      decoded_bytes += cost.decoded_bytes;
      if (cost.feature == "instances") {
        EXPECT_EQ(cost.decoded_bytes, 700u * 136);
      }
    }
    EXPECT_EQ(names, features);
    EXPECT_EQ(pages, (*file)->page_count());
    EXPECT_EQ(store_bytes, (*file)->footer().file_bytes);
    EXPECT_EQ(decoded_bytes, (*file)->footer().decoded_bytes);
  }
}

TEST(Costs, OfAPageThatIsNoneAreRefused) {
  const TempFolder folder;
  const std::string path = tests::build_store(folder, "scene.mill", some_scene());
  tests::flip(path, sizeof(storage::StoreHeader), 0x80);  // the first page's type
  const auto costs = store_costs(path);
  EXPECT_EQ(costs.status().code(), ErrorCode::corrupt);
  EXPECT_NE(costs.status().message().find("page "), std::string::npos) << costs.status().message();
}

}  // namespace
}  // namespace raymill
