// Any two configurations give the same hits: instruction set, width, page size, codec, positions, threads, memory,
// pushes, fields and the place of the build's threads are drawn from one seed, which a failure prints.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"

namespace raymill::tests {
namespace {

constexpr int kStep = -12;  // positions are multiples of 2^-12, which float32 keeps too

struct Configuration {
  BuildConfig build = small_pages();
  TraceSetup setup;
  bool least = false;

  [[nodiscard]] std::string text() const {
    return "width " + std::to_string(build.width) + ", pages of " + std::to_string(build.page_bytes) + ", codec " +
           build.codec + ", positions " + build.positions + ", built by " + std::to_string(build.threads) +
           " threads; " + setup.engine.isa + ", " + std::to_string(setup.engine.threads) + " threads, " +
           (least ? "least" : "plenty of") + " memory, layout " + setup.engine.layout + ", sorting " +
           setup.engine.sort_rays + ", pushes of " + std::to_string(setup.push_rays) + ", fields " +
           to_string(setup.trace.fields);
  }
};

Configuration draw(Random& random) {
  Configuration c;
  c.build.width = pick(random, {4u, 8u});
  c.build.page_bytes = pick(random, {16u << 10, 20u << 10, 64u << 10, 1u << 20});
  c.build.codec = pick<std::string>(random, {"raw", "lz4", "zstd", "draco"});
  c.build.positions = c.build.codec == "draco" || random.below(2) == 0 ? "lattice:0.000244140625" : "float32";
  c.build.threads = pick(random, {1u, 2u, 3u});
  const std::vector<std::string> isas = available_isas();
  c.setup.engine.isa = isas[random.below(static_cast<std::uint32_t>(isas.size()))];
  c.setup.engine.threads = pick(random, {1u, 2u, 4u});
  c.setup.engine.layout = pick<std::string>(random, {"auto", "compact", "expanded"});
  c.setup.engine.sort_rays = pick<std::string>(random, {"auto", "never", "always"});
  c.setup.push_rays = pick<std::size_t>(random, {0, 1, 97, 1024, 3000});
  c.setup.trace.fields = random.below(2) == 0 ? Field::all : Field(1 + random.below(63));
  c.least = c.setup.engine.layout != "expanded" && random.below(2) == 0;
  return c;
}

Scene draw_scene(Random& random) {
  Scene scene;
  const std::uint32_t parts = 1 + random.below(4);
  for (std::uint32_t i = 0; i < parts; ++i) {
    switch (random.below(6)) {
      case 0:
        scene.push_back(soup(random, 200 + random.below(4000), 0.1F));
        break;
      case 1:
        scene.push_back(grid(5 + random.below(40), 0.3F));
        break;
      case 2:
        scene.push_back(sphere({0, 0, 0}, 1, 8 + random.below(20), 8 + random.below(40)));
        break;
      case 3:
        scene.push_back(needles(random, 100 + random.below(1000)));
        break;
      case 4:
        scene.push_back(boxes(random, 1 + random.below(200)));
        break;
      default:
        scene.push_back(scene.empty() ? coincident(300) : scene[0]);
        break;
    }
  }
  return snapped(scene, kStep);
}

class Configurations : public testing::TestWithParam<std::uint64_t> {};

TEST_P(Configurations, GiveTheSameHits) {
  const char* asked = std::getenv("RAYMILL_PROPERTY_SEED");
  const std::uint64_t seed = asked != nullptr ? std::strtoull(asked, nullptr, 10) : GetParam();
  SCOPED_TRACE("replay with RAYMILL_PROPERTY_SEED=" + std::to_string(seed));
  Random random(seed);
  const TempFolder folder;
  const Scene scene = draw_scene(random);
  const std::vector<Ray> rays = mixed_rays(random, scene, 4000);

  const Mode mode = pick(random, {Mode::watertight, Mode::fast, Mode::exact, Mode::exact});
  std::vector<Hit> first;
  std::string first_text;
  for (int i = 0; i < 4; ++i) {
    Configuration c = draw(random);
    c.setup.trace.mode = mode;
    c.setup.trace.fields = i == 0 ? Field::all : c.setup.trace.fields;
    const std::string path = build_store(folder, "scene" + std::to_string(i) + ".mill", scene, c.build);
    Traced traced = c.least ? trace_with_least_memory(path, rays, c.setup) : trace(path, rays, c.setup);
    ASSERT_TRUE(traced.status.ok()) << traced.status.message() << "\n" << c.text();
    ASSERT_EQ(traced.hits.size(), rays.size());
    if (i == 0) {
      first = std::move(traced.hits);
      first_text = c.text();
    } else {
      const HitLayout layout(c.setup.trace.fields);
      std::vector<std::byte> row(layout.row_bytes());
      for (std::size_t k = 0; k < rays.size(); ++k) {
        layout.write(first[k], row.data());
        const Hit expected = layout.read(row.data());
        ASSERT_TRUE(same_bits(traced.hits[k], expected))
            << "ray " << k << ": " << text_of(rays[k]) << "\n  " << text_of(expected) << " by " << first_text << "\n  "
            << text_of(traced.hits[k]) << " by " << c.text();
      }
    }
    c.setup.trace.query = Query::any;
    const Traced any = c.least ? trace_with_least_memory(path, rays, c.setup) : trace(path, rays, c.setup);
    ASSERT_EQ(any.hits.size(), rays.size()) << any.status.message();
    for (std::size_t k = 0; k < rays.size(); ++k) {
      ASSERT_EQ(any.hits[k].t == 0, first[k].primitive_id != kNoId) << text_of(rays[k]) << " by " << c.text();
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, Configurations, testing::Range(std::uint64_t{1}, std::uint64_t{13}));

}  // namespace
}  // namespace raymill::tests
