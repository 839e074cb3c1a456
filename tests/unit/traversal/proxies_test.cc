// Answers within a tolerance: proxies stand for subtrees, alike in whatever schedule, budget, layout and machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "storage/pages/page_image.h"
#include "tests/support/effort.h"
#include "tests/support/instances.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "traversal/kernel.h"
#include "traversal/slab.h"

namespace raymill::tests {
namespace {

using storage::ExternalKind;
using storage::PageView;

constexpr std::size_t kProxyRays = kSanitized ? 500 : 3000;

BuildConfig with_proxies(unsigned width = 8) {
  BuildConfig config = small_pages();
  config.proxies = true;
  config.width = width;
  return config;
}

// A sheet with bumps over a ball, and rays from all around.
struct Proxied {
  Proxied() {
    scene = {moved(grid(90, 0.05F), {-1, -1, 0}, 2), rough_sphere(random, 0.4F, 0.45F, 60, 60)};
    storage::Aabb box;
    box.grow(storage::Vec3f{-1, -1, -0.5F});
    box.grow(storage::Vec3f{1, 1, 0.5F});
    rays = random_rays(random, box, kProxyRays);
    const std::vector<Ray> odd = hostile_rays();
    rays.insert(rays.end(), odd.begin(), odd.end());
  }
  Random random{7};
  TempFolder folder;
  Scene scene;
  std::vector<Ray> rays;
};

std::size_t proxy_hits(const std::vector<Hit>& hits) {
  return static_cast<std::size_t>(
      std::count_if(hits.begin(), hits.end(), [](const Hit& hit) { return hit.u == kProxyBarycentric; }));
}

void expect_alike(const std::vector<Hit>& found, const std::vector<Hit>& expected, const std::vector<Ray>& rays,
                  const std::string& by) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_TRUE(same_bits(found[i], expected[i])) << by << ", ray " << i << ": " << text_of(rays[i]) << "\n  "
                                                  << text_of(expected[i]) << "\n  " << text_of(found[i]);
  }
}

TEST(Proxies, EveryScheduleIsaAndOrderGivesTheSameHits) {
  Proxied f;
  for (const unsigned width : {4U, 8U}) {
    const LoadedPages pages =
        load_pages(build_store(f.folder, "w" + std::to_string(width), f.scene, with_proxies(width)));
    for (const Query query : {Query::closest, Query::any}) {
      for (const Mode mode : {Mode::watertight, Mode::fast}) {
        KernelRun run{.query = query, .mode = mode, .batch_rays = 64, .footprint = {0.2, 0.01}};
        const KernelHits first = run_kernel(pages, f.rays, run);
        EXPECT_GT(first.counters.proxies_taken, kProxyRays / 20);
        for (const traversal::Isa isa : traversal::runnable_isas()) {
          for (const Residency residency : {Residency::all, Residency::one_page, Residency::random}) {
            run.isa = isa;
            run.residency = residency;
            run.batch_rays = residency == Residency::all ? 1 : 100;
            expect_alike(run_kernel(pages, f.rays, run).hits, first.hits, f.rays,
                         "width " + std::to_string(width) + " " + std::string(to_string(isa)));
          }
        }
      }
    }
  }
}

TEST(Proxies, WithoutAToleranceTheStoreAnswersAsOneWithoutThem) {
  Proxied f;
  const std::string plain = build_store(f.folder, "plain", f.scene),
                    rich = build_store(f.folder, "rich", f.scene, with_proxies());
  TraceSetup setup;
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    setup.trace.mode = mode;
    for (const char* layout : {"compact", "expanded"}) {
      setup.engine.layout = layout;
      expect_alike(trace(rich, f.rays, setup).hits, trace(plain, f.rays, setup).hits, f.rays, layout);
    }
  }
}

// The ray's way through a box: slab.h, in float64.
struct BoxWay {
  double entry = -std::numeric_limits<double>::infinity(), exit = std::numeric_limits<double>::infinity();
};

template <int N>
void add_ways(const PageView& view, const Ray& ray, std::vector<BoxWay>& ways) {
  const std::uint32_t count = std::uint32_t(view.header().node_count) + view.header().ghost_count;
  for (std::uint32_t i = 0; i < count; ++i) {
    const storage::Node<N>& node = view.nodes<N>()[i];
    for (unsigned slot = 0; slot < N; ++slot) {
      if ((node.external >> slot & 1) == 0 || view.externals()[node.child[slot]].kind != ExternalKind::proxied) {
        continue;
      }
      BoxWay way;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (ray.dir[axis] == 0) {
          continue;  // inside the slab or not: no end of a way
        }
        const float scale = storage::power_of_two(node.exponent[axis]);
        const double a =
            (double(storage::decode_plane(node.base[axis], scale, node.lower[axis][slot])) - ray.org[axis]) /
            ray.dir[axis];
        const double b =
            (double(storage::decode_plane(node.base[axis], scale, node.upper[axis][slot])) - ray.org[axis]) /
            ray.dir[axis];
        way.entry = std::fmax(way.entry, std::fmin(a, b));
        way.exit = std::fmin(way.exit, std::fmax(a, b));
      }
      ways.push_back(way);
    }
  }
}

// So the true hit, where there is one in the box, is no further away than the tolerance.
TEST(Proxies, AHitLiesInTheMiddleOfAWayThroughABoxThatIsShortEnough) {
  Proxied f;
  constexpr double kTolerance = 0.1;
  const LoadedPages pages = load_pages(build_store(f.folder, "s", f.scene, with_proxies()));
  const KernelRun run{.batch_rays = 64, .footprint = {kTolerance, 0}};
  const std::vector<Hit> hits = run_kernel(pages, f.rays, run).hits;
  ASSERT_GT(proxy_hits(hits), kProxyRays / 50);
  for (std::size_t i = 0; i < f.rays.size(); ++i) {
    if (hits[i].u != kProxyBarycentric) {
      continue;
    }
    const Ray& ray = f.rays[i];
    EXPECT_LT(hits[i].geometry_id, 2U);
    EXPECT_NE(hits[i].primitive_id, kNoId);
    EXPECT_GT(hits[i].t, ray.tnear);
    std::vector<BoxWay> ways;
    for (const auto& image : pages.images) {
      add_ways<8>(PageView(image.data()), ray, ways);
    }
    const double length = std::hypot(ray.dir[0], ray.dir[1], ray.dir[2]);
    EXPECT_TRUE(std::any_of(ways.begin(), ways.end(), [&](const BoxWay& way) {
      return std::fabs((way.entry + way.exit) / 2 - hits[i].t) <= 1e-5 * (1 + std::fabs(hits[i].t)) &&
             (way.exit - way.entry) / 2 * length <= kTolerance && way.entry > ray.tnear;
    })) << text_of(ray);
  }
}

// Where triangles cover their boxes, nearly all hits and misses are right, and off by no more than the tolerance.
TEST(Proxies, OnASheetSeenFromAboveHitsAreRightWithinTheTolerance) {
  Random random(3);
  const TempFolder folder;
  const std::string store = build_store(folder, "sheet", {grid(120, 0.05F)}, with_proxies());
  std::vector<Ray> rays;
  for (std::size_t i = 0; i < kProxyRays; ++i) {
    rays.push_back(ray({random.uniform(-0.2F, 1.2F), random.uniform(-0.2F, 1.2F), 3}, {0.02F, 0.01F, -2}));
  }
  TraceSetup setup;
  setup.trace.mode = Mode::exact;
  const std::vector<Hit> truth = trace(store, rays, setup).hits;
  setup.trace.mode = Mode::watertight;
  setup.trace.tolerance = 0.1;
  const Traced found = trace(store, rays, setup);
  EXPECT_GT(proxy_hits(found.hits), kProxyRays / 3);
  EXPECT_GT(found.stats.proxies_taken, kProxyRays / 3);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const bool should_hit = std::isfinite(truth[i].t), hits = std::isfinite(found.hits[i].t);
    wrong += should_hit != hits ? 1 : 0;
    if (should_hit && hits) {
      EXPECT_LE(std::fabs(found.hits[i].t - truth[i].t) * 2, 0.1F);  // dir is two long
    }
  }
  EXPECT_LE(wrong, kProxyRays / 50);
}

TEST(Proxies, ARayThatBeginsInABoxMeetsWhatIsThere) {
  Proxied f;
  const std::string store = build_store(f.folder, "s", f.scene, with_proxies());
  const std::vector<storage::Vec3f> vertices = vertices_of(f.scene[1]);
  std::vector<Ray> rays;
  for (std::size_t i = 0; i < vertices.size(); i += 3) {
    const storage::Vec3f& v = vertices[i];
    rays.push_back(ray(v, {v.x, v.y, v.z}));  // outwards, from the surface of the ball
    rays.back().tfar = 1e-4F;
  }
  TraceSetup setup;
  const std::vector<Hit> expected = trace(store, rays, setup).hits;
  setup.trace.tolerance = 10;
  expect_alike(trace(store, rays, setup).hits, expected, rays, "from the surface");
}

TEST(Proxies, TheEngineAnswersAlikeInEveryBudgetAndSchedule) {
  Proxied f;
  Random random(5);
  std::vector<Ray> rays = f.rays;
  const std::string flat = build_store(f.folder, "flat", f.scene, with_proxies());
  for (const std::string& store :
       {flat, build_placed(f.folder, "placed.mill", random_placed_scene(random, 60), with_proxies())}) {
    TraceSetup setup;
    setup.trace.tolerance = 0.3;
    setup.trace.tolerance_angle = 0.05;
    const Traced expected = trace(store, rays, setup);
    ASSERT_TRUE(expected.status.ok()) << expected.status.message();
    EXPECT_GT(expected.stats.proxies_taken, 0U);
    EXPECT_EQ(expected.stats.rays_expanded, 0U);
    TraceSetup other = setup;
    other.engine.threads = 3;
    other.engine.sort_rays = "always";
    expect_alike(trace(store, rays, other).hits, expected.hits, rays, "threads, sorted");
    expect_alike(trace_with_least_memory(store, rays, setup).hits, expected.hits, rays, "least memory");
    other = setup;
    other.engine.adversarial = true;
    expect_alike(trace(store, rays, other).hits, expected.hits, rays, "one page at a time");
    std::reverse(rays.begin(), rays.end());
    std::vector<Hit> backwards = trace(store, rays, setup).hits;
    std::reverse(rays.begin(), rays.end());
    std::reverse(backwards.begin(), backwards.end());
    expect_alike(backwards, expected.hits, rays, "backwards");
  }
}

TEST(Proxies, WhatDoesNotGoTogetherIsRefused) {
  Proxied f;
  const std::string plain = build_store(f.folder, "plain", f.scene),
                    rich = build_store(f.folder, "rich", f.scene, with_proxies());
  const auto refused = [&](const std::string& store, const char* word, const auto& change) {
    TraceSetup setup;
    setup.trace.tolerance = 0.1;
    change(setup);
    const auto engine = Engine::create(setup.engine);
    ASSERT_TRUE(engine.ok());
    const auto open = (*engine)->open(store);
    ASSERT_TRUE(open.ok());
    const auto job = (*open)->trace(setup.trace);
    ASSERT_FALSE(job.ok()) << word;
    EXPECT_EQ(job.status().code(), ErrorCode::invalid_argument);
    EXPECT_NE(job.status().message().find(word), std::string::npos) << job.status().message();
  };
  refused(plain, "--proxies", [](TraceSetup&) {});
  refused(rich, "exact", [](TraceSetup& s) { s.trace.mode = Mode::exact; });
  refused(rich, "closest and any", [](TraceSetup& s) {
    s.trace.query = Query::count;
    s.trace.fields = Field::count;
  });
  refused(rich, "finite", [](TraceSetup& s) { s.trace.tolerance = -1; });
  refused(rich, "finite", [](TraceSetup& s) { s.trace.tolerance_angle = std::nan(""); });
  refused(rich, "expanded", [](TraceSetup& s) { s.engine.layout = "expanded"; });
}

TEST(Proxies, AGeometryThatIsMaskedOutIsNotHitByProxy) {
  Proxied f;
  const std::string store = build_store(f.folder, "s", f.scene, with_proxies());
  TraceSetup setup;
  setup.trace.tolerance = 0.2;
  setup.trace.geometry_masks = std::make_shared<const std::vector<std::uint32_t>>(std::vector<std::uint32_t>{0, 1});
  const std::vector<Hit> hits = trace(store, f.rays, setup).hits;
  EXPECT_GT(proxy_hits(hits), 0U);
  for (const Hit& hit : hits) {
    EXPECT_NE(hit.geometry_id, 0U);
  }
}

}  // namespace
}  // namespace raymill::tests
