// Placed objects: what a ray finds, whatever the schedule, the budget and the machine.
#include "tests/support/instances.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tests/support/effort.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "traversal/kernel.h"

namespace raymill::tests {
namespace {

using traversal::Isa;

constexpr std::size_t kInstanceRays = kSanitized ? 600 : 3000;

struct InstanceFixture {
  explicit InstanceFixture(std::uint64_t seed, std::size_t places = 40) : random(seed) {
    scene = random_placed_scene(random, places);
    storage::Aabb box;
    box.grow(storage::Vec3f{-7, -7, -7});
    box.grow(storage::Vec3f{7, 7, 7});
    rays = random_rays(random, box, kInstanceRays);
    const std::vector<Ray> odd = hostile_rays();
    rays.insert(rays.end(), odd.begin(), odd.end());
  }
  Random random;
  TempFolder folder;
  PlacedScene scene;
  std::vector<Ray> rays;
};

void expect_same(const std::vector<Hit>& found, const std::vector<Hit>& expected, const std::vector<Ray>& rays,
                 const std::string& by) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_TRUE(same_bits(found[i], expected[i])) << by << ", ray " << i << ": " << text_of(rays[i]) << "\n  "
                                                  << text_of(expected[i]) << "\n  " << text_of(found[i]);
  }
}

// Normals are turned into the world and have no counterpart in the object's store.
void drop_normals(std::vector<Hit>& hits) {
  for (Hit& hit : hits) {
    hit.normal = {};
  }
}

TEST(Instances, HitsAreThoseOfEachObjectWithTheRayInItsSpace) {
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    InstanceFixture f(11);
    if (mode == Mode::exact) {
      f.scene.places.pop_back();  // at equal t exact decides between the instances, not between their ids
    }
    std::vector<Hit> expected = expected_hits(f.folder, f.scene, f.rays, mode);
    TraceSetup setup;
    setup.trace.mode = mode;
    std::vector<Hit> found = trace(build_placed(f.folder, "placed.mill", f.scene), f.rays, setup).hits;
    drop_normals(expected);
    drop_normals(found);
    expect_same(found, expected, f.rays, "mode " + std::string(to_string(mode)));
    const auto in_objects =
        std::count_if(found.begin(), found.end(), [](const Hit& hit) { return hit.instance_id != kNoId; });
    EXPECT_GT(in_objects, std::ptrdiff_t(kInstanceRays / 10));
  }
}

// The bound of storage/FORMAT.md: corners and rays that differ by a rounding. Rays that graze are left out.
TEST(Instances, HitsAreThoseOfTheFlattenedSceneWithinRounding) {
  InstanceFixture f(12);
  const std::vector<Hit> placed = trace(build_placed(f.folder, "placed.mill", f.scene), f.rays).hits;
  const std::vector<Hit> flat = trace(build_store(f.folder, "flat.mill", flattened(f.scene)), f.rays).hits;
  std::size_t same = 0, hits = 0;
  for (std::size_t i = 0; i < f.rays.size(); ++i) {
    hits += flat[i].primitive_id != kNoId ? 1 : 0;
    if (flat[i].primitive_id == kNoId || flat[i].geometry_id != placed[i].geometry_id ||
        flat[i].primitive_id != placed[i].primitive_id) {
      continue;
    }
    ++same;
    const auto& n = flat[i].normal;
    const auto& d = f.rays[i].dir;
    const float along = std::fabs(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) / std::hypot(d[0], d[1], d[2]);
    if (along > 0.1F) {
      EXPECT_NEAR(placed[i].t, flat[i].t, 2e-5F * std::fabs(flat[i].t) + 2e-5F) << text_of(f.rays[i]);
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(placed[i].normal[axis], n[axis], 2e-3F) << text_of(f.rays[i]);
    }
  }
  EXPECT_GE(same + hits / 200, hits) << "all but some at edges";
}

// Of crossings a ray keeps the count alone.
std::vector<Hit> comparable(std::vector<Hit> hits, Query query) {
  for (Hit& hit : hits) {
    Hit count;
    count.count = hit.count;
    hit = query == Query::all ? count : hit;
  }
  return hits;
}

TEST(Instances, EveryScheduleOfPagesGivesTheSameBits) {
  for (const unsigned width : {4U, 8U}) {
    InstanceFixture f(13, 150);
    BuildConfig config = small_pages();
    config.width = width;
    const LoadedPages pages = load_pages(build_placed(f.folder, "placed.mill", f.scene, config));
    ASSERT_GT(pages.images.size(), 6U);
    for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
      for (const Query query : {Query::closest, Query::any, Query::all}) {
        KernelRun run;
        run.query = query;
        run.mode = mode;
        const std::vector<Hit> expected = comparable(run_kernel(pages, f.rays, run).hits, query);
        for (const Isa isa : traversal::runnable_isas()) {
          for (const Residency residency : {Residency::all, Residency::one_page, Residency::random}) {
            run.isa = isa;
            run.residency = residency;
            run.batch_rays = residency == Residency::one_page ? 1 : 57;
            const KernelHits found = run_kernel(pages, f.rays, run);
            EXPECT_FALSE(found.corrupt);
            expect_same(comparable(found.hits, query), expected, f.rays,
                        std::string(to_string(isa)) + ", " + std::string(to_string(query)) + ", " +
                            std::string(to_string(mode)));
          }
        }
      }
    }
  }
}

TEST(Instances, EveryConfigurationGivesTheSameBytes) {
  InstanceFixture f(14, 120);
  std::string first;
  for (int i = 0; i < 8; ++i) {
    BuildConfig build = small_pages();
    build.width = i % 2 == 0 ? 8 : 4;
    build.page_bytes = pick(f.random, {16U << 10, 64U << 10});
    build.codec = pick<std::string>(f.random, {"raw", "lz4", "zstd"});
    build.threads = 1 + f.random.below(3);
    const std::string path = build_placed(f.folder, "placed" + std::to_string(i) + ".mill", f.scene, build);
    const auto verified = verify(path);
    ASSERT_TRUE(verified) << verified.status().message();
    EXPECT_EQ(verified->instances, f.scene.places.size());
    TraceSetup setup;
    setup.engine.threads = 1 + f.random.below(3);
    setup.engine.adversarial = i == 3 || i == 4;
    setup.engine.sort_rays = pick<std::string>(f.random, {"auto", "always"});
    setup.push_rays = pick<std::size_t>(f.random, {0, 97});
    const Traced traced = i >= 5 ? trace_with_least_memory(path, f.rays, setup) : trace(path, f.rays, setup);
    ASSERT_TRUE(traced.status.ok()) << traced.status.message();
    first = i == 0 ? traced.rows : first;
    EXPECT_TRUE(traced.rows == first) << "configuration " << i;
  }
}

TEST(Instances, QueriesAgree) {
  InstanceFixture f(15);
  const std::string path = build_placed(f.folder, "placed.mill", f.scene);
  const std::vector<Hit> closest = trace(path, f.rays).hits;
  TraceSetup setup;
  setup.trace.query = Query::any;
  const std::vector<Hit> any = trace(path, f.rays, setup).hits;
  setup.trace.query = Query::count;
  const std::vector<Hit> count = trace(path, f.rays, setup).hits;
  setup.trace.query = Query::all;
  const Traced all = trace(path, f.rays, setup);
  ASSERT_EQ(all.offsets.size(), f.rays.size() + 1);
  for (std::size_t i = 0; i < f.rays.size(); ++i) {
    const bool hit = closest[i].primitive_id != kNoId;
    EXPECT_EQ(any[i].t == 0, hit) << text_of(f.rays[i]);
    if (std::isnan(closest[i].t)) {
      EXPECT_EQ(count[i].count, kNoCount);
      continue;
    }
    EXPECT_EQ(count[i].count, all.offsets[i + 1] - all.offsets[i]);
    EXPECT_EQ(count[i].count > 0, hit) << text_of(f.rays[i]);
    if (count[i].count > 0) {
      const Hit& nearest = all.hits[all.offsets[i]];
      EXPECT_EQ(nearest.t, closest[i].t) << text_of(f.rays[i]);
      // At an edge the crossing may be of another triangle (traversal/crossings.md).
      EXPECT_EQ(nearest.instance_id, closest[i].instance_id) << text_of(f.rays[i]);
    }
  }
}

TEST(Instances, ARayPassesThroughTheSurfaceOfOneInstanceAlone) {
  PlacedScene scene;
  scene.objects = {{grid(1)}};  // z = 0 over the unit square
  for (int i = 0; i < 3; ++i) {
    scene.places.push_back({0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, double(i), 1}});
  }
  const TempFolder folder;
  const std::string path = build_placed(folder, "stack.mill", scene);
  const std::vector<Ray> rays{ray({0.3F, 0.2F, -1}, {0, 0, 1})};
  TraceSetup setup;
  const Hit first = trace(path, rays, setup).hits[0];
  EXPECT_EQ(first.geometry_id, 0U);
  EXPECT_EQ(first.instance_id, 0U);
  EXPECT_EQ(first.t, 1);
  setup.trace.skips = true;
  setup.skipped = {{first.geometry_id, first.primitive_id}};
  const Hit second = trace(path, rays, setup).hits[0];
  EXPECT_EQ(second.geometry_id, 1U) << "the same triangle of the object, in another place";
  EXPECT_EQ(second.t, 2);
  setup.trace.skips = false;
  setup.skipped.clear();
  setup.trace.geometry_masks = std::make_shared<std::vector<std::uint32_t>>(std::vector<std::uint32_t>{0, 0, 1});
  EXPECT_EQ(trace(path, rays, setup).hits[0].geometry_id, 2U);
}

// A millimetre stays one: the object's own coordinates are small, whatever the place.
TEST(Instances, AnObjectFarFromTheOriginKeepsItsShape) {
  PlacedScene scene;
  Mesh steps;
  for (int i = 0; i < 16; ++i) {
    for (Corners c : moved(grid(1), {0.001F * float(i), 0, 0.001F * float(i)}, 0.001F)) {
      steps.push_back(c);
    }
  }
  scene.objects = {{steps}};
  scene.places = {{0, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 65536.0, 0, 0, 1}}};
  const TempFolder folder;
  const std::string path = build_placed(folder, "far.mill", scene);
  // From where float32 still has a step of 2^-7: the ray's own rounding is not the object's.
  const Ray down = ray({65536, 0.0005F, 1}, {0, 0, -1});
  const Hit hit = trace(path, std::vector<Ray>{down}).hits[0];
  EXPECT_EQ(hit.t, 1);
  EXPECT_EQ(hit.geometry_id, 0U);
}

TEST(Instances, TheExpandedLayoutIsRefusedAndTheOthersAreTaken) {
  InstanceFixture f(16, 3);
  const std::string path = build_placed(f.folder, "placed.mill", f.scene);
  TraceSetup setup;
  setup.engine.layout = "expanded";
  const Traced refused = trace(path, f.rays, setup);
  EXPECT_EQ(refused.status.code(), ErrorCode::unsupported);
  EXPECT_NE(refused.status.message().find("instances"), std::string::npos);
}

}  // namespace
}  // namespace raymill::tests
