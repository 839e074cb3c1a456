// The layouts of a store in memory: the same hits by all, when one goes over into the other, and what is refused.
#include <gtest/gtest.h>

#include <cstring>
#include <thread>

#include "storage/pages/store_format.h"
#include "tests/support/effort.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "traversal/engine.h"

namespace raymill {
namespace {

using tests::Random;
using tests::TempFolder;
using tests::Traced;
using tests::TraceSetup;

constexpr std::uint32_t kSoupTriangles = 1500;

class LayoutTest : public testing::Test {
 protected:
  LayoutTest() {
    Random random(1);
    scene_ = {tests::soup(random, kSoupTriangles, 0.1F), tests::grid(10, 0.1F), tests::coincident(100)};
    rays_ = tests::mixed_rays(random, scene_, 5000);
  }
  std::string store(unsigned width) {
    BuildConfig config = tests::small_pages();
    config.width = width;
    return tests::build_store(folder_, "mbvh" + std::to_string(width) + ".mill", scene_, config);
  }
  static TraceSetup by_layout(const std::string& layout, unsigned threads = 1) {
    TraceSetup setup;
    setup.engine.layout = layout;
    setup.engine.threads = threads;
    return setup;
  }
  // Bits of the same hits.
  static void expect_same(const Traced& a, const Traced& b) {
    ASSERT_TRUE(a.status.ok()) << a.status.message();
    ASSERT_TRUE(b.status.ok()) << b.status.message();
    ASSERT_EQ(a.hits.size(), b.hits.size());
    for (std::size_t i = 0; i < a.hits.size(); ++i) {
      ASSERT_TRUE(tests::same_bits(a.hits[i], b.hits[i]))
          << "ray " << i << ": " << tests::text_of(a.hits[i]) << " and " << tests::text_of(b.hits[i]);
    }
  }

  TempFolder folder_;
  tests::Scene scene_;
  std::vector<Ray> rays_;
};

TEST_F(LayoutTest, EveryKernelGivesTheSameHitsByBoth) {
  for (const unsigned width : {4u, 8u}) {
    const std::string path = store(width);
    for (const std::string& isa : available_isas()) {
      for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
        for (const Query query : {Query::closest, Query::any}) {
          if (tests::kSanitized && (width == 4) != (query == Query::any)) {
            continue;
          }
          SCOPED_TRACE(isa + ", width " + std::to_string(width) + ", " + std::string(to_string(mode)) + ", " +
                       std::string(to_string(query)));
          TraceSetup compact = by_layout("compact"), expanded = by_layout("expanded", 2);
          for (TraceSetup* setup : {&compact, &expanded}) {
            setup->engine.isa = isa;
            setup->trace.mode = mode;
            setup->trace.query = query;
          }
          const Traced by_tree = tests::trace(path, rays_, expanded);
          expect_same(tests::trace(path, rays_, compact), by_tree);
          EXPECT_EQ(by_tree.stats.rays_expanded + by_tree.stats.invalid, rays_.size());
          EXPECT_EQ(by_tree.stats.pages_read, 0u);
          EXPECT_GT(by_tree.stats.expand_seconds, 0);
        }
      }
    }
  }
}

// Rows of a picture; some rays that are odd among them.
std::vector<Ray> picture(std::size_t columns, std::size_t rows) {
  std::vector<Ray> rays(columns * rows);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const float x = float(i % columns) / float(columns) - 0.5F, y = float(i / columns) / float(rows) - 0.5F;
    rays[i].org = {0.1F, 0.2F, 4};
    rays[i].dir = {x * 0.9F, y * 0.9F, -1};
    rays[i].tfar = i % 71 == 0 ? 3.5F : rays[i].tfar;
    rays[i].tnear = i % 67 == 0 ? 3.9F : 0;
    rays[i].dir[0] = i % 501 == 0 ? 0.0F : rays[i].dir[0];
  }
  return rays;
}

TEST_F(LayoutTest, CoherentRaysGoTogetherAndHitWhatTheyHitAlone) {
  const std::vector<Ray> rays = picture(256, 16);
  // Small triangles, where packets share too little and give up, and large ones.
  const tests::Scene small = scene_, large = {tests::sphere({0.1F, 0.2F, 0}, 1.5F, 9, 9)};
  for (const auto& [width, is_large] : {std::pair(4u, false), {8u, false}, {4u, true}, {8u, true}}) {
    if (tests::kSanitized && (width == 4) == is_large) {
      continue;
    }
    scene_ = is_large ? large : small;
    const std::string path = store(width);
    for (const std::string& isa : available_isas()) {
      for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
        for (const Query query : {Query::closest, Query::any}) {
          SCOPED_TRACE(isa + ", width " + std::to_string(width) + ", " + std::string(to_string(mode)) + ", " +
                       std::string(to_string(query)));
          TraceSetup compact = by_layout("compact"), expanded = by_layout("expanded");
          for (TraceSetup* setup : {&compact, &expanded}) {
            setup->engine.isa = isa;
            setup->trace.mode = mode;
            setup->trace.query = query;
          }
          const Traced alone = tests::trace(path, rays, compact), together = tests::trace(path, rays, expanded);
          expect_same(alone, together);
          if (is_large) {
            EXPECT_LT(together.stats.nodes_visited, alone.stats.nodes_visited / 2);
          }
        }
      }
    }
  }
}

TEST_F(LayoutTest, AutoGoesOverWhereRaysAreManyAndMemoryIsPlenty) {
  const std::string path = store(8);
  Random random(4);
  rays_ = tests::mixed_rays(random, scene_, 200'000);  // more than wait at the root page when the tree comes
  const Traced compact = tests::trace(path, rays_, by_layout("compact"));
  EXPECT_EQ(compact.stats.rays_expanded, 0u);
  for (const unsigned threads : {1u, 3u}) {
    TraceSetup setup = by_layout("auto", threads);
    setup.push_rays = 500;
    const Traced both = tests::trace(path, rays_, setup);
    expect_same(compact, both);
    EXPECT_GT(both.stats.rays_expanded, 0u);
    EXPECT_LT(both.stats.rays_expanded, rays_.size() - kSoupTriangles / 2) << "not before as many as triangles";
  }
  const auto few = std::span<const Ray>(rays_).first(kSoupTriangles / 2);
  EXPECT_EQ(tests::trace(path, few, by_layout("auto")).stats.rays_expanded, 0u);
  // Nobody fetches while they are pushed, so there are no more of them than the least memory has places for.
  rays_.resize(60'000);
  const Traced least = tests::trace_with_least_memory(path, rays_, by_layout("auto"));
  expect_same(tests::trace(path, rays_, by_layout("compact")), least);
  EXPECT_EQ(least.stats.rays_expanded, 0u) << "pages come and go";
}

TEST_F(LayoutTest, ASecondJobFindsTheTreeOfTheFirst) {
  EngineConfig config = by_layout("expanded").engine;
  config.max_jobs = 2;
  const auto engine = *Engine::create(config);
  const auto opened = *engine->open(store(8));
  const Traced first = tests::run_job(**opened->trace({}), rays_);
  std::thread beside([&] { expect_same(first, tests::run_job(**opened->trace({}), rays_, 100)); });
  const Traced second = tests::run_job(**opened->trace({}), rays_);
  beside.join();
  expect_same(first, second);
  EXPECT_EQ(first.stats.expand_seconds, second.stats.expand_seconds) << "laid out once";
}

TEST_F(LayoutTest, WhatCannotBeIsRefused) {
  TraceSetup setup = by_layout("wide");
  EXPECT_EQ(Engine::create(setup.engine).status().code(), ErrorCode::invalid_argument);
  setup = by_layout("expanded");
  setup.engine.adversarial = true;
  EXPECT_EQ(Engine::create(setup.engine).status().code(), ErrorCode::invalid_argument);

  // Six megabytes expanded; two more than the least is enough to open it, whatever the process holds by then.
  Random random(2);
  const std::string path = tests::build_store(folder_, "large.mill", {tests::soup(random, 100'000, 0.01F)});
  setup = by_layout("compact");
  tests::set_least_memory(path, setup.engine);
  setup.engine.memory += mebibytes(2);
  setup.engine.layout = "expanded";
  const Status refused = tests::trace(path, rays_, setup).status;
  EXPECT_EQ(refused.code(), ErrorCode::budget_exceeded);
  EXPECT_NE(refused.message().find("the expanded layout needs"), std::string::npos) << refused.message();
}

TEST_F(LayoutTest, ADamagedPageFailsTheJobThatAskedForTheTree) {
  const std::string path = store(8);
  const std::string bytes = tests::read_file(path);
  storage::StoreFooter footer;
  std::memcpy(&footer, bytes.data() + bytes.size() - sizeof footer, sizeof footer);
  storage::PageEntry entry;
  std::memcpy(&entry, bytes.data() + footer.directory_offset + footer.page_count / 2 * sizeof entry, sizeof entry);
  for (const unsigned threads : {1u, 3u}) {
    const auto engine = *Engine::create(by_layout("expanded", threads).engine);
    tests::write_file(folder_ / "copy.mill", bytes);
    const auto opened = *engine->open(folder_ / "copy.mill");
    tests::flip(folder_ / "copy.mill", entry.offset + 40, 0x10);
    EXPECT_EQ(tests::run_job(**opened->trace({}), rays_, 1000).status.code(), ErrorCode::checksum_mismatch);
    EXPECT_EQ(opened->trace({}).status().code(), ErrorCode::checksum_mismatch) << "nor is it tried again";
  }
}

}  // namespace
}  // namespace raymill
