// Stores of many runs: small runs of small scenes, which go every way that a scene of billions goes.
#include "storage/io/store_builder.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <functional>

#include "tests/support/effort.h"
#include "tests/support/stores.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::Scene;
using tests::TempFolder;

struct RunCase {
  const char* name;
  std::function<Scene()> make;
};

std::vector<RunCase> run_cases() {
  return {
      {"soups",
       [] {
         Random random(1);
         return Scene{tests::soup(random, 5000), tests::soup(random, 2000, 0.01F)};
       }},
      {"grids",
       [] {
         return Scene{tests::grid(40, 0.2F), tests::moved(tests::grid(30), {0.5F, 0.5F, 0})};
       }},
      {"nested_shells", [] { return Scene{tests::nested_shells(5000)}; }},
      {"needles",
       [] {
         Random random(2);
         return Scene{tests::needles(random, 4000)};
       }},
      {"coincident",
       [] {
         return Scene{tests::coincident(3000), tests::grid(10)};
       }},
      {"cluster_with_one_far_away",
       [] {
         Random random(3);
         return Scene{tests::soup(random, 4000, 0.01F), tests::moved(tests::grid(1), {2e3F, 2e3F, 2e3F})};
       }},
  };
}

std::uint64_t triangles_in(const Scene& scene) {
  std::uint64_t count = 0;
  for (const tests::Mesh& mesh : scene) {
    count += mesh.size();
  }
  return count;
}

// Room is kept for as many runs as there are threads; here that is all the room there is, so every triangle waits on
// disk. How much a process holds is not known to the megabyte, least of all under a sanitizer: the margins are wide.
void make_wait_on_disk(BuildConfig& config) {
  config.threads = 64;
  config.memory = resident_bytes() + mebibytes(48);
}

class RunsOf : public testing::TestWithParam<std::size_t> {
 protected:
  BuildConfig config(const std::string& name) const {
    BuildConfig config = tests::small_pages();
    config.output = folder_ / name;
    return config;
  }
  const Scene scene_ = run_cases()[GetParam()].make();
  TempFolder folder_;
};
INSTANTIATE_TEST_SUITE_P(Scenes, RunsOf, testing::Range(std::size_t{0}, run_cases().size()),
                         [](const auto& scene) { return run_cases()[scene.param].name; });

TEST_P(RunsOf, VerifyInEveryLayout) {
  for (const unsigned width : {4u, 8u}) {
    for (const std::uint64_t run_triangles : {64u, 500u}) {
      if (tests::kSanitized && (width == 4) != (run_triangles == 64)) {
        continue;
      }
      for (const auto& [codec, positions] : {std::pair("raw", "float32"), std::pair("lz4", "float32"),
                                             std::pair("zstd", "lattice:24b"), std::pair("draco", "lattice:24b")}) {
        if (tests::kSanitized && (width == 4) != (codec == std::string("raw") || codec == std::string("draco"))) {
          continue;
        }
        SCOPED_TRACE("width " + std::to_string(width) + ", runs of " + std::to_string(run_triangles) + ", " + codec);
        BuildConfig layout = config("scene.mill");
        layout.width = width;
        layout.codec = codec;
        layout.positions = positions;
        const auto report = tests::build_in_runs(scene_, layout, run_triangles);
        ASSERT_TRUE(report) << report.status().message();
        EXPECT_GE(report->runs, report->triangles / run_triangles);
        EXPECT_LE(report->levels, max_levels(width));
        const auto verified = verify(layout.output);
        ASSERT_TRUE(verified) << verified.status().message();
        EXPECT_EQ(verified->triangles, report->triangles);
        EXPECT_EQ(verified->pages, report->pages);
        EXPECT_EQ(std::filesystem::file_size(layout.output), report->store_bytes);
        if (positions == std::string("float32")) {
          EXPECT_EQ(report->triangles, triangles_in(scene_));
        }
      }
    }
  }
  EXPECT_EQ(folder_.files(), 1u);
}

TEST_P(RunsOf, GiveTheSameBytesForAnyThreadsAndMemory) {
  for (const std::string positions : {"float32", "lattice:16b"}) {
    if (tests::kSanitized && (positions == "float32") != (GetParam() % 2 == 0)) {
      continue;
    }
    BuildConfig layout = config("scene.mill");
    layout.positions = positions;
    const auto first = tests::build_in_runs(scene_, layout, 64);
    ASSERT_TRUE(first) << first.status().message();
    EXPECT_EQ(first->temporary_bytes, 0u);
    const std::string bytes = tests::read_file(layout.output);
    BuildConfig other = config("other.mill");
    other.positions = positions;
    for (const unsigned threads : {1u, 2u, 4u}) {
      if (tests::kSanitized && threads != 4) {
        continue;
      }
      other.threads = threads;
      other.memory = layout.memory;
      ASSERT_TRUE(tests::build_in_runs(scene_, other, 64));
      EXPECT_EQ(tests::read_file(other.output) == bytes, true) << threads << " threads";
      ASSERT_TRUE(tests::build_in_least_memory(scene_, other, 64));
      EXPECT_EQ(tests::read_file(other.output) == bytes, true) << threads << " threads, least memory";
    }
    make_wait_on_disk(other);
    const auto waited = tests::build_in_runs(scene_, other, 64);
    ASSERT_TRUE(waited) << waited.status().message();
    EXPECT_GT(waited->temporary_bytes, 0u);
    EXPECT_EQ(tests::read_file(other.output) == bytes, true) << "by way of the disk";
    EXPECT_EQ(folder_.files(), 2u);
    EXPECT_EQ(std::filesystem::remove(folder_ / "other.mill"), true);
  }
}

TEST(StoreBuilder, RunsAreAsManyAtOnceAsMemoryAllows) {
  Random random(1);
  const Scene scene{tests::soup(random, 150000)};
  const TempFolder folder;
  BuildConfig config = tests::small_pages();
  config.output = folder / "scene.mill";
  config.threads = 4;
  constexpr std::uint32_t kRunTriangles = 24000;  // a run takes far more than a step of the search for the least memory
  const auto plenty = tests::build_in_runs(scene, config, kRunTriangles);
  ASSERT_TRUE(plenty);
  EXPECT_EQ(plenty->runs_at_once, 5u) << "one is read while four are built";
  const auto one = tests::build_in_runs({tests::grid(3)}, config, 64);
  ASSERT_TRUE(one);
  EXPECT_EQ(one->runs_at_once, 1u) << "there is only one";
  const auto least = tests::build_in_least_memory(scene, config, kRunTriangles);
  ASSERT_TRUE(least) << least.status().message();
  EXPECT_EQ(least->runs_at_once, 1u);
}

TEST(StoreBuilder, TemporaryFileOfAStoreThatGoesToADeviceIsNotBesideIt) {
  Random random(1);
  BuildConfig config = tests::small_pages();
  config.output = "/dev/null";
  make_wait_on_disk(config);
  const auto report = tests::build_in_runs({tests::soup(random, 5000)}, config, 64);
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_GT(report->temporary_bytes, 0u);
  EXPECT_EQ(report->temporary_folder, std::filesystem::temp_directory_path());
}

TEST(StoreBuilder, TooLittleMemoryIsSaidWithTheLeastThatWouldDo) {
  Random random(1);
  const Scene scene{tests::soup(random, 5000)};
  const TempFolder folder;
  BuildConfig config = tests::small_pages();
  config.output = folder / "scene.mill";
  config.threads = 16;
  config.page_bytes = 1 << 20;  // about 10 MiB a thread
  double named_mib = 0;
  for (const std::uint64_t more : {mebibytes(1), mebibytes(4), mebibytes(12)}) {
    config.memory = resident_bytes() + more;
    const auto refused = tests::build_in_runs(scene, config, 500);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.status().code(), ErrorCode::budget_exceeded);
    const std::string& message = refused.status().message();
    const std::string words = "needs at least ";
    ASSERT_NE(message.find(words), std::string::npos) << message;
    named_mib = std::strtod(message.c_str() + message.find(words) + words.size(), nullptr);
    EXPECT_GT(named_mib * 0x1p20, double(config.memory)) << message;
    EXPECT_EQ(folder.files(), 0u);
  }
  config.memory = static_cast<std::uint64_t>(named_mib * 0x1p20) + mebibytes(24);
  const auto built = tests::build_in_runs(scene, config, 500);
  EXPECT_TRUE(built) << built.status().message();
}

TEST(StoreBuilder, StoppedAnywhereItLeavesTheOldStoreAndNothingElse) {
  Random random(1);
  const Scene scene{tests::soup(random, 5000)};
  const TempFolder folder;
  BuildConfig config = tests::small_pages();
  config.output = folder / "scene.mill";
  config.threads = 2;
  int calls = 0;
  config.progress = [&](const char*, double) {
    ++calls;
    return true;
  };
  ASSERT_TRUE(tests::build_in_runs(scene, config, 64));
  const std::string before = tests::read_file(config.output);
  const int all = calls;
  ASSERT_GT(all, 50);
  for (int stop_at = 0; stop_at < all; stop_at += tests::kSanitized ? 37 : 11) {
    calls = 0;
    config.progress = [&](const char*, double) { return calls++ != stop_at; };
    EXPECT_EQ(tests::build_in_runs(scene, config, 64).status().code(), ErrorCode::interrupted);
    EXPECT_EQ(calls, stop_at + 1) << "nothing goes on after it";
    EXPECT_EQ(tests::read_file(config.output) == before, true);
    EXPECT_EQ(folder.files(), 1u);
  }
}

TEST(StoreBuilder, TrianglesThatTheLatticeDropsAreReportedOnce) {
  Random random(1);
  const Scene scene{tests::soup(random, 2000), tests::moved(tests::soup(random, 700), {}, 1e-5F)};
  const TempFolder folder;
  BuildConfig config = tests::small_pages();
  config.output = folder / "scene.mill";
  config.positions = "lattice:10b";
  auto triangles = tests::triangles_of(scene);
  const auto snapped = snap_to_lattice(*parse_positions(config.positions), triangles);
  ASSERT_TRUE(snapped);
  ASSERT_GE(snapped->dropped_degenerate, 700u);
  const auto report = tests::build_in_runs(scene, config, 64);
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_EQ(report->triangles, triangles.size());
  EXPECT_EQ(report->max_displacement, snapped->max_displacement);
  const std::string count = "\"count\":" + std::to_string(snapped->dropped_degenerate) + "}";
  EXPECT_NE(report->import_json.find(count), std::string::npos) << report->import_json;
  EXPECT_NE(report->import_json.find("\"kept\":" + std::to_string(triangles.size())), std::string::npos);
}

}  // namespace
}  // namespace raymill::storage
