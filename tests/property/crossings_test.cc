// Counts and lists of crossings are the same bytes whatever the layout, the instruction set, the memory, the threads,
// the pushes and the schedule; and a list is as long as its count says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"

namespace raymill::tests {
namespace {

struct Drawn {
  TraceSetup setup;
  bool least = false;

  [[nodiscard]] std::string text() const {
    return setup.engine.isa + ", " + std::to_string(setup.engine.threads) + " threads, " +
           (least ? "least" : "plenty of") + " memory, layout " + setup.engine.layout +
           (setup.engine.adversarial ? ", adversarial" : "") + ", sorting " + setup.engine.sort_rays + ", pushes of " +
           std::to_string(setup.push_rays);
  }
};

Drawn draw_setup(Random& random) {
  Drawn drawn;
  const std::vector<std::string> isas = available_isas();
  EngineConfig& engine = drawn.setup.engine;
  engine.isa = isas[random.below(static_cast<std::uint32_t>(isas.size()))];
  engine.threads = pick(random, {1u, 2u, 3u});
  engine.layout = pick<std::string>(random, {"auto", "compact", "expanded"});
  engine.sort_rays = pick<std::string>(random, {"auto", "never", "always"});
  engine.adversarial = engine.layout == "compact" && random.below(2) == 0;
  drawn.setup.push_rays = pick<std::size_t>(random, {0, 97, 1024});
  drawn.least = engine.layout != "expanded" && random.below(3) != 0;
  return drawn;
}

Traced trace_drawn(const std::string& path, const std::vector<Ray>& rays, const Drawn& drawn) {
  return drawn.least ? trace_with_least_memory(path, rays, drawn.setup) : trace(path, rays, drawn.setup);
}

class Crossings : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, Crossings, testing::Range(std::uint64_t{1}, std::uint64_t{7}));

void expect_ordered(const Traced& lists, std::size_t ray) {
  for (std::uint64_t i = lists.offsets[ray] + 1; i < lists.offsets[ray + 1]; ++i) {
    const Hit &a = lists.hits[i - 1], &b = lists.hits[i];
    EXPECT_LT(std::tie(a.t, a.geometry_id, a.primitive_id), std::tie(b.t, b.geometry_id, b.primitive_id));
  }
}

// Of every list the first hits.
std::string first_rows(const Traced& lists, std::uint64_t first) {
  const std::size_t row_bytes = lists.rows.size() / std::max<std::size_t>(lists.hits.size(), 1);
  std::string rows;
  for (std::size_t ray = 0; ray + 1 < lists.offsets.size(); ++ray) {
    const std::uint64_t count = std::min(lists.offsets[ray + 1] - lists.offsets[ray], first);
    rows += lists.rows.substr(lists.offsets[ray] * row_bytes, count * row_bytes);
  }
  return rows;
}

TEST_P(Crossings, AreTheSameWhateverTheConfiguration) {
  const std::uint64_t seed = GetParam();
  Random random(seed);
  const TempFolder folder;
  const Scene scene = {soup(random, 3000, 0.3F), grid(20, 0.3F), boxes(random, 30), coincident(40)};
  const std::vector<Ray> rays = mixed_rays(random, scene, 700);
  BuildConfig build = small_pages();
  build.width = seed % 2 == 0 ? 4 : 8;
  const std::string path = build_store(folder, "scene.mill", scene, build);
  const Mode mode = std::array{Mode::watertight, Mode::exact, Mode::fast}[seed % 3];

  TraceSetup closest;
  closest.trace.mode = mode;
  const Traced nearest = trace(path, rays, closest);
  Traced lists, counts;
  for (int i = 0; i < 4; ++i) {
    Drawn drawn = draw_setup(random);
    SCOPED_TRACE(drawn.text());
    drawn.setup.trace.mode = mode;
    drawn.setup.trace.query = Query::count;
    const Traced count = trace_drawn(path, rays, drawn);
    drawn.setup.trace.query = Query::all;
    const Traced all = trace_drawn(path, rays, drawn);
    ASSERT_TRUE(all.status.ok() && count.status.ok()) << all.status.message() << count.status.message();
    ASSERT_EQ(all.offsets.size(), rays.size() + 1);
    ASSERT_EQ(count.hits.size(), rays.size());
    EXPECT_EQ(all.stats.crossings, all.hits.size());
    EXPECT_EQ(all.stats.crossings, count.stats.crossings);
    EXPECT_EQ(all.stats.hits, count.stats.hits);
    if (i == 0) {
      lists = all;
      counts = count;
    }
    EXPECT_TRUE(all.rows == lists.rows && all.offsets == lists.offsets);
    EXPECT_TRUE(count.rows == counts.rows);
    drawn.setup.trace.first = 1 + random.below(3);
    const Traced first = trace_drawn(path, rays, drawn);
    EXPECT_TRUE(first.rows == first_rows(lists, drawn.setup.trace.first));
  }
  std::size_t invalid = 0;
  for (std::size_t ray = 0; ray < rays.size(); ++ray) {
    const bool is_invalid = std::isnan(nearest.hits[ray].t);
    invalid += is_invalid ? 1 : 0;
    EXPECT_EQ(counts.hits[ray].count, is_invalid ? kNoCount : lists.offsets[ray + 1] - lists.offsets[ray]);
    expect_ordered(lists, ray);
    if (lists.offsets[ray] < lists.offsets[ray + 1]) {
      EXPECT_LE(nearest.hits[ray].t, lists.hits[lists.offsets[ray]].t) << "no crossing before the closest hit";
    }
  }
  EXPECT_EQ(invalid, counts.stats.invalid);
  EXPECT_GT(lists.hits.size(), 3 * rays.size());
}

// As many hits as there are shells, in order, in memory that knows nothing of their number.
TEST(NestedShells, AreListedInOrderInTheLeastMemory) {
  const TempFolder folder;
  constexpr std::size_t kShells = 600;
  Mesh shells;
  for (std::size_t i = 0; i < kShells; ++i) {
    const float r = 1 + float(i) * 0.01F;
    shells.push_back({Vec3f{-r, -r, r}, {r, -r, r}, {0, r, r + 0.5F}});
  }
  const std::string path = build_store(folder, "shells.mill", {shells});
  Random random(1);
  std::vector<Ray> rays;
  for (int i = 0; i < 300; ++i) {
    rays.push_back(ray({random.uniform(-0.1F, 0.1F), random.uniform(-0.1F, 0.1F), 1e4F}, {0, 0, -1}));
  }
  TraceSetup setup;
  setup.trace.query = Query::all;
  const Traced plenty = trace(path, rays, setup), least = trace_with_least_memory(path, rays, setup);
  ASSERT_TRUE(least.status.ok()) << least.status.message();
  EXPECT_TRUE(plenty.rows == least.rows && plenty.offsets == least.offsets);
  EXPECT_EQ(least.hits.size(), kShells * rays.size());
  EXPECT_GT(least.pieces, rays.size() / 2) << "output larger than its memory";
  EXPECT_GT(least.stats.result_spill_bytes, 2 * least.rows.size()) << "and than what it is sorted in";
  for (std::size_t ray = 0; ray < rays.size(); ++ray) {
    expect_ordered(least, ray);
  }
}

}  // namespace
}  // namespace raymill::tests
