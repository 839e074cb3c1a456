// Whatever goes out of memory when, the hits are the same: every way to evict, and the adversarial schedule, in which
// every ray suspends at every node and a page is evicted when a batch has run there.
#include <gtest/gtest.h>

#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"

namespace raymill::tests {
namespace {

class Schedules : public testing::TestWithParam<std::uint64_t> {};

TEST_P(Schedules, GiveTheSameHits) {
  const std::uint64_t seed = GetParam();
  Random random(seed);
  const TempFolder folder;
  const Scene scene = {soup(random, 3000, 0.1F), grid(25, 0.3F), boxes(random, 50)};
  const std::vector<Ray> rays = mixed_rays(random, scene, 1500);
  BuildConfig build = small_pages();
  build.width = seed % 2 == 0 ? 4 : 8;
  const std::string path = build_store(folder, "scene.mill", scene, build);

  TraceSetup setup;
  setup.trace.query = seed % 3 == 0 ? Query::any : Query::closest;
  setup.trace.mode = seed % 2 == 0 ? Mode::exact : Mode::watertight;
  const Traced in_core = trace(path, rays, setup);
  ASSERT_TRUE(in_core.status.ok()) << in_core.status.message();
  EXPECT_EQ(in_core.stats.evictions, 0u);
  for (const std::string& isa : available_isas()) {
    for (const char* eviction : {"clock", "demand"}) {
      for (const bool adversarial : {false, true}) {
        setup.engine.isa = isa;
        setup.engine.eviction = eviction;
        setup.engine.adversarial = adversarial;
        setup.engine.threads = 1 + random.below(3);
        const Traced least = trace_with_least_memory(path, rays, setup);
        SCOPED_TRACE(isa + ", " + eviction + (adversarial ? ", adversarial" : ""));
        ASSERT_TRUE(least.status.ok()) << least.status.message();
        EXPECT_EQ(least.stats.eviction, eviction);
        EXPECT_TRUE(least.rows == in_core.rows);
        if (adversarial) {
          EXPECT_GT(least.stats.rays_parked, in_core.stats.nodes_visited / 2) << "every node suspends";
          EXPECT_GT(least.stats.evictions, least.stats.distinct_pages) << "every batch evicts";
        }
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, Schedules, testing::Range(std::uint64_t{1}, std::uint64_t{7}));

}  // namespace
}  // namespace raymill::tests
