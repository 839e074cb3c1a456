// Files that stand in the repository: stores of every format version, and the worked example of storage/FORMAT.md.
//
//   raymill_golden_tests             compares
//   raymill_golden_tests --rewrite   renews the example, and writes what is missing; it never changes a kept store
#include "tests/golden/golden.h"

#include <gtest/gtest.h>
#include <zstd.h>

#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "storage/base/checksum.h"
#include "tests/golden/format_example.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"

namespace raymill::tests {

static bool is_rewriting = false;
bool rewrite() { return is_rewriting; }

namespace {

const std::string kSpecification = RAYMILL_SOURCE_DIR "/storage/FORMAT.md";

struct KeptStore {
  const char* name;
  const char* codec;
  const char* positions;
  unsigned width;
};
// One for each codec; both widths, both kinds of position.
constexpr KeptStore kKeptStores[] = {
    {"format_1_raw", "raw", "float32", 4},
    {"format_1_lz4", "lz4", "lattice:0.0009765625", 8},
    {"format_1_zstd", "zstd", "float32", 8},
    {"format_1_draco", "draco", "lattice:0.0009765625", 4},
};

Scene kept_scene() {
  Random random(1);
  return snapped({soup(random, 12, 0.6F), grid(3, 0.4F), coincident(2)}, -10);
}

std::vector<Ray> kept_rays() {
  Random random(2);
  std::vector<Ray> rays = random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 2000);
  const std::vector<Ray> hostile = hostile_rays();
  rays.insert(rays.end(), hostile.begin(), hostile.end());
  return rays;
}

std::string hash_of(const Traced& traced) {
  // A NaN has many bit patterns; the answer to an invalid ray is any of them.
  std::string text;
  for (const Hit& hit : traced.hits) {
    text += (std::isnan(hit.t) ? "invalid" : text_of(hit)) + "\n";
  }
  char hash[32];
  std::snprintf(hash, sizeof hash, "%016llx\n",
                static_cast<unsigned long long>(storage::checksum(std::as_bytes(std::span(text)))));
  return hash;
}

class OldStore : public testing::TestWithParam<KeptStore> {};

TEST_P(OldStore, IsReadAndGivesItsHits) {
  const KeptStore kept = GetParam();
  const std::string path = kGolden + kept.name + ".mill", hits = kGolden + kept.name + ".hits";
  if (rewrite() && !std::filesystem::exists(path)) {
    const TempFolder folder;
    BuildConfig config = small_pages();
    config.codec = kept.codec;
    config.positions = kept.positions;
    config.width = kept.width;
    write_file(path, read_file(build_store(folder, kept.name, kept_scene(), config)));
    write_file(hits, hash_of(trace(path, kept_rays())));
  }
  EXPECT_LT(std::filesystem::file_size(path), 4096u);
  const auto verified = verify(path);
  ASSERT_TRUE(verified) << verified.status().message();
  for (const std::string& isa : available_isas()) {
    TraceSetup setup;
    setup.engine.isa = isa;
    const Traced traced = trace(path, kept_rays(), setup);
    ASSERT_TRUE(traced.status.ok()) << traced.status.message();
    EXPECT_GT(traced.stats.hits, 100u);
    EXPECT_EQ(hash_of(traced), read_file(hits)) << isa;
  }
}

// Whatever was kept, the same scene gives the same hits today.
TEST_P(OldStore, AndAStoreOfTodayGiveTheSameHits) {
  const KeptStore kept = GetParam();
  const TempFolder folder;
  EXPECT_EQ(hash_of(trace(build_store(folder, "now.mill", kept_scene()), kept_rays())),
            read_file(kGolden + kept.name + ".hits"));
}

INSTANTIATE_TEST_SUITE_P(Kept, OldStore, testing::ValuesIn(kKeptStores),
                         [](const auto& param) { return std::string(param.param.name); });

TEST(Specification, ExampleHasTheBytesOfARealStore) {
  const std::string begin = "<!-- example: begin -->\n", end = "<!-- example: end -->\n";
  const std::string text = read_file(kSpecification);
  const std::size_t from = text.find(begin), to = text.find(end);
  ASSERT_TRUE(from != std::string::npos && to != std::string::npos && from < to) << kSpecification;
  const std::string kept = text.substr(from + begin.size(), to - from - begin.size());
  const TempFolder folder;
  const std::string current = "```\n" + format_example(folder) + "```\n";
  if (rewrite() && kept != current) {
    write_file(kSpecification, text.substr(0, from + begin.size()) + current + text.substr(to));
    return;
  }
  if (kept.find("by zstd " + std::string(ZSTD_versionString()) + "\n") == std::string::npos) {
    // Equal bytes are promised for equal libraries only; the version that made the example stands in it.
    GTEST_SKIP() << "the example was made with another zstd, which may compress the metadata to other bytes";
  }
  EXPECT_EQ(kept, current) << "raymill_golden_tests --rewrite renews it";
}

}  // namespace
}  // namespace raymill::tests

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--rewrite") == 0) {
      raymill::tests::is_rewriting = true;
    }
  }
  return RUN_ALL_TESTS();
}
