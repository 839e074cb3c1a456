// Hits that do not count: those of the primitive that a ray passes through, as the surface that it leaves, and those
// of geometries whose mask has no bit of the ray's. Everything else is hit as ever.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "tests/support/brute_force.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill {
namespace {

using tests::Random;
using tests::TempFolder;
using tests::Traced;
using tests::TraceSetup;

PrimitiveIds ids_of(const Hit& hit) { return {hit.geometry_id, hit.primitive_id}; }

class HitFilterTest : public testing::Test {
 protected:
  HitFilterTest() {
    Random random(1);
    scene_ = {tests::soup(random, 1500, 0.3F), tests::sphere({}, 0.8F, 10, 16), tests::grid(12, 0.3F)};
    path_ = tests::build_store(folder_, "scene.mill", scene_);
    const auto rays = tests::random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 1500);
    const Traced first = tests::trace(path_, rays);
    // On from where they hit, some back, some with nothing to pass through.
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Hit& hit = first.hits[i];
      if (hit.primitive_id == kNoId) {
        continue;
      }
      Ray& ray = rays_.emplace_back(rays[i]);
      ray.tnear = 0;
      ray.tfar = i % 5 == 0 ? 0.5F : INFINITY;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ray.org[axis] += hit.t * ray.dir[axis];
        ray.dir[axis] = i % 3 == 0 ? -ray.dir[axis] : ray.dir[axis];
      }
      skipped_.push_back(i % 7 == 0 ? PrimitiveIds() : ids_of(hit));
    }
  }
  TraceSetup setup(Query query, Mode mode, const char* layout) {
    TraceSetup setup;
    setup.trace.query = query;
    setup.trace.mode = mode;
    setup.trace.skips = true;
    setup.engine.layout = layout;
    setup.skipped = skipped_;
    return setup;
  }

  TempFolder folder_;
  tests::Scene scene_;
  std::string path_;
  std::vector<Ray> rays_;
  std::vector<PrimitiveIds> skipped_;
};

TEST_F(HitFilterTest, TheListLacksThePrimitiveAndNothingElse) {
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    TraceSetup everything = setup(Query::all, mode, "compact");
    everything.trace.skips = false;
    everything.skipped.clear();
    const Traced whole = tests::trace(path_, rays_, everything);
    const Traced lists = tests::trace(path_, rays_, setup(Query::all, mode, "expanded"));
    const Traced counts = tests::trace_with_least_memory(path_, rays_, setup(Query::count, mode, "compact"));
    ASSERT_TRUE(lists.status.ok() && counts.status.ok()) << lists.status.message() << counts.status.message();
    std::size_t lacking = 0, at = 0;
    for (std::size_t ray = 0; ray < rays_.size(); ++ray) {
      std::uint32_t count = 0;
      for (std::uint64_t i = whole.offsets[ray]; i < whole.offsets[ray + 1]; ++i) {
        if (ids_of(whole.hits[i]) == skipped_[ray]) {
          ++lacking;
        } else {
          ASSERT_TRUE(tests::same_bits(whole.hits[i], lists.hits.at(at++)));
          ++count;
        }
      }
      EXPECT_EQ(lists.offsets[ray + 1], at);
      EXPECT_EQ(counts.hits[ray].count, count);
    }
    EXPECT_GT(lacking, rays_.size() / 4) << "rounding puts many origins behind the surface";
  }
}

TEST_F(HitFilterTest, TheNearestOfTheOthersIsHitInEveryLayout) {
  for (const Mode mode : {Mode::watertight, Mode::exact}) {
    const Traced compact = tests::trace_with_least_memory(path_, rays_, setup(Query::closest, mode, "compact"));
    const Traced expanded = tests::trace(path_, rays_, setup(Query::closest, mode, "expanded"));
    const Traced any = tests::trace(path_, rays_, setup(Query::any, mode, "compact"));
    ASSERT_TRUE(compact.status.ok()) << compact.status.message();
    EXPECT_TRUE(compact.rows == expanded.rows);
    const auto triangles = tests::triangles_of(scene_);
    for (std::size_t ray = 0; ray < rays_.size(); ++ray) {
      const Hit& hit = compact.hits[ray];
      EXPECT_TRUE(hit.primitive_id == kNoId || ids_of(hit) != skipped_[ray]);
      EXPECT_EQ(any.hits[ray].t == 0, hit.primitive_id != kNoId);
      if (ray % 16 == 0) {
        auto others = triangles;
        std::erase_if(others, [&](const tests::Triangle& t) {
          return PrimitiveIds{t.geometry_id, t.primitive_id} == skipped_[ray];
        });
        EXPECT_EQ(tests::oracle_objects(others, rays_[ray], hit, 16), "") << tests::text_of(rays_[ray]);
      }
    }
  }
}

// Coherent rays go as packets there.
TEST_F(HitFilterTest, PacketsPassThroughToo) {
  std::vector<Ray> rays;
  for (int i = 0; i < 64 * 64; ++i) {
    rays.push_back(tests::ray({0, 0, 3}, {float(i % 64) / 640, float(i / 64) / 640, -1}));
  }
  TraceSetup first = setup(Query::closest, Mode::watertight, "expanded");
  first.trace.skips = false;
  first.skipped.clear();
  const Traced hits = tests::trace(path_, rays, first);
  TraceSetup second = setup(Query::closest, Mode::watertight, "expanded");
  second.skipped.clear();
  for (const Hit& hit : hits.hits) {
    second.skipped.push_back(ids_of(hit));
  }
  const Traced by_tree = tests::trace(path_, rays, second);
  second.engine.layout = "compact";
  const Traced by_pages = tests::trace(path_, rays, second);
  EXPECT_TRUE(by_tree.rows == by_pages.rows);
  EXPECT_LT(by_tree.stats.nodes_visited, by_pages.stats.nodes_visited / 2) << "they went together";
  for (std::size_t i = 0; i < rays.size(); ++i) {
    EXPECT_TRUE(hits.hits[i].primitive_id == kNoId || ids_of(by_tree.hits[i]) != ids_of(hits.hits[i]));
  }
}

TEST_F(HitFilterTest, MasksLeaveGeometriesOut) {
  Random random(5);
  const std::vector<std::uint32_t> of_geometries{1, 6};  // the third has every bit
  std::vector<std::uint32_t> of_rays(rays_.size());
  for (std::uint32_t& mask : of_rays) {
    mask = random.below(16);
  }
  TraceSetup everything = setup(Query::all, Mode::watertight, "compact");
  everything.trace.skips = false;
  everything.skipped.clear();
  const Traced whole = tests::trace(path_, rays_, everything);
  for (const std::uint32_t of_all : {kAllMask, 5u}) {
    for (const char* layout : {"compact", "expanded"}) {
      TraceSetup masked = everything;
      masked.engine.layout = layout;
      masked.trace.masks = true;
      masked.trace.mask = of_all;
      masked.trace.geometry_masks = std::make_shared<const std::vector<std::uint32_t>>(of_geometries);
      masked.masks = of_rays;
      masked.push_rays = 700;
      const Traced lists = tests::trace(path_, rays_, masked);
      masked.trace.query = Query::any;
      masked.engine.layout = "compact";
      const Traced any = tests::trace_with_least_memory(path_, rays_, masked);
      ASSERT_TRUE(lists.status.ok() && any.status.ok()) << lists.status.message() << any.status.message();
      std::size_t left_out = 0, at = 0;
      for (std::size_t ray = 0; ray < rays_.size(); ++ray) {
        const std::size_t before = at;
        for (std::uint64_t i = whole.offsets[ray]; i < whole.offsets[ray + 1]; ++i) {
          const Hit& hit = whole.hits[i];
          const std::uint32_t mask = hit.geometry_id < 2 ? of_geometries[hit.geometry_id] & of_rays[ray] & of_all : 1;
          if (mask == 0) {
            ++left_out;
          } else {
            ASSERT_TRUE(tests::same_bits(hit, lists.hits.at(at++)));
          }
        }
        EXPECT_EQ(lists.offsets[ray + 1], at);
        EXPECT_EQ(any.hits[ray].t == 0, at > before);
      }
      EXPECT_GT(left_out, whole.hits.size() / 4);
      EXPECT_GT(at, whole.hits.size() / 4);
    }
  }
}

TEST_F(HitFilterTest, WhatCannotBeIsRefused) {
  const auto engine = *Engine::create(EngineConfig{.memory = gibibytes(8), .threads = 1});
  const auto store = *engine->open(path_);
  {
    const auto job = *store->trace({});
    EXPECT_EQ(job->push_with(rays_, {.skipped = skipped_}).code(), ErrorCode::invalid_argument) << "no such job";
  }
  TraceConfig skips;
  skips.skips = true;
  const auto job = *store->trace(skips);
  EXPECT_EQ(job->push_with(rays_, {.skipped = std::span(skipped_).subspan(1)}).code(), ErrorCode::invalid_argument);
  const std::vector<std::uint32_t> masks(rays_.size(), 1);
  EXPECT_EQ(job->push_with(rays_, {.masks = masks}).code(), ErrorCode::invalid_argument) << "nor such a job";
  EXPECT_TRUE(job->push(rays_).ok()) << "rays that pass through nothing";
  TraceConfig alone;
  alone.mask = 1;
  EXPECT_EQ(store->trace(alone).status().code(), ErrorCode::invalid_argument) << "no masks to hold it against";
}

// Rays that leave a closed surface from corners, edges and middles, rounded as a caller rounds them: the triangle that
// they leave is no hit, whatever side of it they begin on, and no other is lost: who goes in comes to the far side.
TEST(SelfIntersection, LeavingASurfaceMeetsItsNeighboursAndNotItself) {
  Random random(21);
  const TempFolder folder;
  const tests::Mesh mesh = tests::rough_sphere(random, 1, 1.5F, 10, 14);
  const std::string path = tests::build_store(folder, "rough.mill", {mesh});
  const auto triangles = tests::triangles_of({mesh});
  TraceSetup setup;
  setup.trace.skips = true;
  std::vector<Ray> rays;
  std::size_t inward = 0;
  for (const tests::Triangle& triangle : triangles) {
    constexpr float kPlaces[][3] = {{1, 0, 0},       {0, 1, 0},       {0, 0, 1},         {0.5F, 0.5F, 0},
                                    {0, 0.3F, 0.7F}, {0.9F, 0, 0.1F}, {0.4F, 0.3F, 0.3F}};
    for (const auto& w : kPlaces) {
      tests::Vec3f from;
      for (int axis = 0; axis < 3; ++axis) {
        from[axis] = w[0] * triangle.v[0][axis] + w[1] * triangle.v[1][axis] + w[2] * triangle.v[2][axis];
      }
      rays.push_back(tests::ray_towards(from, random.in_box(-0.3F, 0.3F)));
      rays.push_back(tests::ray(from, random.direction()));
      setup.skipped.insert(setup.skipped.end(), 2, {triangle.geometry_id, triangle.primitive_id});
      ++inward;
    }
  }
  for (const Mode mode : {Mode::watertight, Mode::exact}) {
    setup.trace.mode = mode;
    setup.engine.layout = mode == Mode::exact ? "compact" : "expanded";
    const Traced traced = tests::trace(path, rays, setup);
    ASSERT_EQ(traced.hits.size(), 2 * inward);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Hit& hit = traced.hits[i];
      ASSERT_NE(ids_of(hit), setup.skipped[i]) << tests::text_of(rays[i]);
      ASSERT_TRUE(i % 2 == 1 || std::isfinite(hit.t)) << "it goes in and nowhere out: " << tests::text_of(rays[i]);
    }
  }
}

}  // namespace
}  // namespace raymill
