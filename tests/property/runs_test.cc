// How a scene was cut into runs, and what memory it was built in, are nothing that a ray could tell: stores of the same
// scene with runs of any size give the same hits, byte for byte, in core and at the least memory.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "storage/build/partition.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"

namespace raymill::tests {
namespace {

constexpr int kRunsStep = -12;  // positions are multiples of 2^-12, so the lattice keeps them

Scene draw_cut_scene(Random& random) {
  Scene scene;
  switch (random.below(6)) {
    case 0:
      scene = {soup(random, 3000, 0.1F), grid(20, 0.3F)};
      break;
    case 1:
      scene = {grid(40, 0.3F), moved(grid(20, 0.1F), {0.25F, 0.25F, 0.1F})};
      break;
    case 2:
      scene = {nested_shells(1500), sphere({0, 0, 0}, 3, 20, 40)};
      break;
    case 3:
      scene = {needles(random, 3000)};
      break;
    case 4:
      scene = {coincident(700), boxes(random, 200), coincident(300)};
      break;
    default:
      scene = {soup(random, 2500, 0.02F), moved(boxes(random, 3), {500, 500, 500})};
      break;
  }
  return snapped(scene, kRunsStep);
}

struct Built {
  std::string path;
  std::string text;
};

Built build_drawn(Random& random, const TempFolder& folder, const Scene& scene, std::uint64_t run_triangles) {
  BuildConfig config = small_pages();
  config.output = folder / ("runs_of_" + std::to_string(run_triangles) + ".mill");
  config.width = pick(random, {4u, 8u});
  config.page_bytes = pick(random, {16u << 10, 64u << 10});
  config.codec = pick<std::string>(random, {"raw", "lz4", "zstd", "draco"});
  config.positions = config.codec == "draco" || random.below(2) == 0 ? "lattice:0.000244140625" : "float32";
  config.threads = pick(random, {1u, 2u});
  const bool least = random.below(3) == 0;
  const auto report =
      least ? build_in_least_memory(scene, config, run_triangles) : build_in_runs(scene, config, run_triangles);
  EXPECT_TRUE(report.ok()) << report.status().message();
  return {config.output, "runs of " + std::to_string(run_triangles) + ", width " + std::to_string(config.width) +
                             ", codec " + config.codec + ", positions " + config.positions +
                             (least ? ", built in the least memory" : "")};
}

class Runs : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Runs, testing::Range(std::uint64_t{1}, std::uint64_t{13}));

TEST_P(Runs, OfAnySizeGiveTheSameHits) {
  const char* asked = std::getenv("RAYMILL_PROPERTY_SEED");
  const std::uint64_t seed = asked != nullptr ? std::strtoull(asked, nullptr, 10) : GetParam();
  SCOPED_TRACE("replay with RAYMILL_PROPERTY_SEED=" + std::to_string(seed));
  Random random(seed);
  const TempFolder folder;
  const Scene scene = draw_cut_scene(random);
  const std::vector<Ray> rays = mixed_rays(random, scene, 1500);

  TraceSetup setup;
  setup.trace.mode = pick(random, {Mode::watertight, Mode::fast, Mode::exact});
  std::string closest_rows, any_rows, first;
  for (const std::uint64_t run_triangles : {storage::kRunTriangles, std::uint64_t{500}, std::uint64_t{64}}) {
    const Built built = build_drawn(random, folder, scene, run_triangles);
    for (const bool least : {false, true}) {
      SCOPED_TRACE(built.text + (least ? ", least memory" : "") + "; the first: " + first);
      for (const Query query : {Query::closest, Query::any}) {
        setup.trace.query = query;
        const Traced traced = least ? trace_with_least_memory(built.path, rays, setup) : trace(built.path, rays, setup);
        ASSERT_TRUE(traced.status.ok()) << traced.status.message();
        std::string& expected = query == Query::any ? any_rows : closest_rows;
        if (expected.empty()) {
          expected = traced.rows;
          first = built.text;
        }
        EXPECT_EQ(traced.rows == expected, true) << to_string(query);
      }
    }
  }
  EXPECT_FALSE(closest_rows.empty());
}

}  // namespace
}  // namespace raymill::tests
