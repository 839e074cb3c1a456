#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>

#include "storage/io/store_file.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/volumes.h"
#include "traversal/volume/volume_kernel.h"
#include "traversal/volume/volume_math.h"

namespace raymill::tests {
namespace {

using namespace storage;
using namespace traversal;

constexpr std::uint32_t kPageBytes = 16 << 10;

struct Span {
  float begin, end;
  bool operator==(const Span&) const = default;
};

// A volume in memory, all of its pages resident.
class Resident {
 public:
  explicit Resident(const TestVolume& volume, std::optional<std::int32_t> step_exponent = {})
      : built_(build_volume(volume, kPageBytes, step_exponent)),
        images_(built_.pages.size()),
        touched_(built_.pages.size()) {
    for (std::size_t page = 0; page < images_.size(); ++page) {
      images_[page] = built_.pages[page].data();
    }
  }
  [[nodiscard]] const BuiltVolume& built() const { return built_; }

  Hit run(Query query, const VolumeConfig& config, const Ray& ray, bool lone_items = false) {
    spans_.clear();
    CrossingBuffer crossings{.room = room_, .owner = &spans_};
    crossings.take = [](void* to, std::span<const Crossing> some) {
      auto& spans = *static_cast<std::vector<Span>*>(to);
      for (const Crossing& crossing : some) {
        spans.push_back({crossing.hit.t, crossing.hit.u});
      }
    };
    RayState state;
    state.org = ray.org;
    state.dir = ray.dir;
    state.tnear = ray.tnear;
    state.tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
    VolumeContext context{.volumes = {&built_.volume, 1}, .query = query, .config = config, .need_normal = true};
    context.images = images_.data();
    context.touched = touched_.data();
    context.lone_items = lone_items;
    context.crossings = &crossings;
    begin_volumes(query, config, context.volumes, state);
    for (int i = 0; i < 100000 && !state.done; ++i) {
      run_volumes(context, {&state, 1});
    }
    EXPECT_TRUE(state.done);
    EXPECT_FALSE(context.corrupt);
    crossings.empty();
    return state.hit;
  }
  std::vector<Span> spans(double threshold, const Ray& ray, bool lone_items = false) {
    run(Query::spans, {.threshold = threshold}, ray, lone_items);
    return spans_;
  }

 private:
  BuiltVolume built_;
  std::vector<std::atomic<const std::byte*>> images_;
  std::vector<std::atomic<std::uint8_t>> touched_;
  std::array<Crossing, 2> room_;  // few, so that it is emptied on the way
  std::vector<Span> spans_;
};

VolumeConfig march(double step) { return {.method = VolumeMethod::march, .step = step}; }
VolumeConfig ratio(std::uint64_t seed) { return {.method = VolumeMethod::ratio, .seed = seed}; }

TEST(VolumePages, AreValidAndBoundedExactly) {
  for (const std::optional<std::int32_t> step : {std::optional<std::int32_t>(), std::optional<std::int32_t>(-10)}) {
    const BuiltVolume built = build_volume(wavy_fog(50), kPageBytes, step);
    const VolumeRules rules{kPageBytes, static_cast<std::uint32_t>(built.pages.size()), 1};
    std::uint64_t bricks = 0;
    for (const PageBuffer& page : built.pages) {
      EXPECT_EQ(validate_volume_image(page, rules).message(), "");
      EXPECT_EQ(check_bounds(page.data(), {&built.volume, 1}).message(), "");
      bricks += VolumePageView(page.data()).header().brick_count;
    }
    EXPECT_EQ(bricks, built.volume.brick_count);
    EXPECT_GT(built.pages.size(), 4U);
  }
}

TEST(VolumeKernel, ExactTransmittanceIsThatOfADenseSum) {
  const TestVolume fog = wavy_fog(50);
  Resident resident(fog);
  for (const Ray& ray : rays_through(fog, 40, 1)) {
    EXPECT_NEAR(resident.run(Query::transmittance, {}, ray).t, std::exp(-dense_depth(fog, ray, 2000)), 1e-5);
  }
}

TEST(VolumeKernel, MarchingErrorFallsWithTheSquareOfTheStep) {
  const TestVolume fog = wavy_fog(50);
  Resident resident(fog);
  double coarse = 0, fine = 0;
  for (const Ray& ray : rays_through(fog, 200, 2)) {
    const double exact = resident.run(Query::transmittance, {}, ray).t;
    coarse += std::pow(resident.run(Query::transmittance, march(0.1), ray).t - exact, 2);
    fine += std::pow(resident.run(Query::transmittance, march(0.025), ray).t - exact, 2);
  }
  EXPECT_GT(std::sqrt(coarse / fine), 8);  // 16 where the field were smooth
  EXPECT_GT(fine, 0);
}

TEST(VolumeKernel, TrackingIsRightOnTheAverage) {
  const TestVolume fog = wavy_fog(50);
  Resident resident(fog);
  double mean = 0, exact = 0, square = 0;
  int estimates = 0;
  for (const Ray& ray : rays_through(fog, 60, 3)) {
    const double truth = resident.run(Query::transmittance, {}, ray).t;
    for (std::uint64_t seed = 0; seed < 200; ++seed, ++estimates) {
      const double estimate = resident.run(Query::transmittance, ratio(seed), ray).t;
      mean += estimate;
      exact += truth;
      square += (estimate - truth) * (estimate - truth);
    }
  }
  const double deviation = std::sqrt(square) / estimates;
  EXPECT_GT(deviation, 0);
  EXPECT_LT(std::fabs(mean - exact) / estimates, 4 * deviation);
}

TEST(VolumeKernel, LatticeRoundsByHalfAStepAtMost) {
  const TestVolume fog = wavy_fog(50);
  Resident exact(fog), rounded(fog, -8);
  for (const Ray& ray : rays_through(fog, 50, 4)) {
    const Way way = way_through(fog, ray);
    const double length =
        std::max(0.0, way.end - way.begin) *
        std::sqrt(double(ray.dir[0]) * ray.dir[0] + double(ray.dir[1]) * ray.dir[1] + double(ray.dir[2]) * ray.dir[2]);
    const double depth = -std::log(exact.run(Query::transmittance, {}, ray).t);
    EXPECT_NEAR(-std::log(rounded.run(Query::transmittance, {}, ray).t), depth, length * 0x1p-9 + 1e-5);
  }
}

TEST(VolumeKernel, LevelSetIsHitWhereTheFieldChangesItsSign) {
  const TestVolume surface = ball(48, {0.5, 0.45, 0.52}, 0.3);
  Resident resident(surface);
  int hits = 0;
  for (const Ray& ray : rays_through(surface, 80, 5)) {
    const Hit hit = resident.run(Query::closest, {}, ray);
    EXPECT_EQ(resident.run(Query::any, {}, ray).t < 1, hit.t < 1e30F);
    const Way way = way_through(surface, ray);
    constexpr int kSteps = 1000;
    const double step = (way.end - way.begin) / kSteps;
    double change = std::numeric_limits<double>::infinity();
    for (int i = 1; i <= kSteps && way.begin < way.end && change > way.end; ++i) {
      const bool before = field_at(surface, ray, way.begin + (i - 1) * step) < 0;
      change = before != (field_at(surface, ray, way.begin + i * step) < 0) ? way.begin + i * step : change;
    }
    if (change > way.end) {
      EXPECT_GT(hit.t, 1e30F);
      continue;
    }
    ++hits;
    EXPECT_NEAR(hit.t, change - step / 2, step);
    double along = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double outward = ray.org[axis] + ray.dir[axis] * double(hit.t) - std::array{0.5, 0.45, 0.52}[axis];
      along += outward / 0.3 * hit.normal[axis];
    }
    EXPECT_GT(along, 0.98);
  }
  EXPECT_GT(hits, 15);
}

// Whether the field at samples all along the way is above the threshold where spans say so; those that lie on it count
// for both.
bool agree(const std::vector<Span>& spans, const TestVolume& fog, const Ray& ray, double threshold) {
  constexpr int kSamples = 2000;
  const Way way = way_through(fog, ray);
  std::size_t next = 0;
  for (int i = 0; i < kSamples && way.begin < way.end; ++i) {
    const double t = way.begin + (i + 0.5) * (way.end - way.begin) / kSamples;
    while (next < spans.size() && spans[next].end < t) {
      ++next;
    }
    const bool inside = next < spans.size() && spans[next].begin <= t;
    const double above = field_at(fog, ray, t) - threshold;
    if (std::fabs(above) > 1e-4 && inside != (above > 0)) {
      return false;
    }
  }
  return true;
}

TEST(VolumeKernel, SpansAreWhereTheFieldIsAboveTheThreshold) {
  const TestVolume fog = wavy_fog(50);
  Resident resident(fog);
  std::size_t most = 0, total = 0;
  for (const Ray& ray : rays_through(fog, 100, 8)) {
    const Way way = way_through(fog, ray);
    for (const double threshold : {0.0, 0.25, 0.5}) {
      const std::vector<Span> spans = resident.spans(threshold, ray);
      EXPECT_TRUE(agree(spans, fog, ray, threshold));
      for (std::size_t i = 0; i < spans.size(); ++i) {
        EXPECT_LE(spans[i].begin, spans[i].end);
        EXPECT_TRUE(i == 0 || spans[i - 1].end < spans[i].begin);
        for (const float t : {spans[i].begin, spans[i].end}) {
          const bool is_cut = std::fabs(t - way.begin) < 1e-5 || std::fabs(t - way.end) < 1e-5;
          EXPECT_TRUE(is_cut || std::fabs(field_at(fog, ray, t) - threshold) < 1e-4) << t;
        }
      }
      most = std::max(most, spans.size());
      total += spans.size();
    }
  }
  EXPECT_GT(most, 3U);
  EXPECT_GT(total, 150U);
}

TEST(VolumeKernel, ASpanGoesOnFromBrickToBrickAndEndsWithTheRay) {
  TestVolume fog = wavy_fog(50);
  fog.value = [](int, int, int) { return 0.5F; };
  Resident resident(fog);
  for (const Ray& ray : rays_through(fog, 40, 9)) {
    const Way way = way_through(fog, ray);
    const std::vector<Span> spans = resident.spans(0.4, ray);
    EXPECT_EQ(spans, resident.spans(0.4, ray, true));
    EXPECT_TRUE(resident.spans(0.5, ray).empty()) << "what equals the threshold is not above it";
    ASSERT_EQ(spans.size(), way.begin < way.end ? 1U : 0U);
    if (!spans.empty()) {
      EXPECT_NEAR(spans[0].begin, way.begin, 1e-6);
      EXPECT_NEAR(spans[0].end, way.end, 1e-6 * way.end);
    }
  }
}

TEST(VolumeKernel, WaitingAtEveryItemChangesNoBit) {
  const TestVolume fog = wavy_fog(50), surface = ball(48, {0.5, 0.45, 0.52}, 0.3);
  Resident in_fog(fog), at_surface(surface);
  for (const Ray& ray : rays_through(fog, 60, 6)) {
    for (const VolumeConfig& config : {VolumeConfig(), march(0.05), ratio(7)}) {
      EXPECT_EQ(in_fog.run(Query::transmittance, config, ray, true).t, in_fog.run(Query::transmittance, config, ray).t);
    }
    EXPECT_EQ(in_fog.spans(0.4, ray, true), in_fog.spans(0.4, ray));
  }
  for (const Ray& ray : rays_through(surface, 60, 7)) {
    EXPECT_EQ(at_surface.run(Query::closest, {}, ray, true).t, at_surface.run(Query::closest, {}, ray).t);
  }
}

TEST(VolumeMath, IsThatOfTheLibrary) {
  for (int i = 0; i < 10000; ++i) {
    EXPECT_NEAR(exp_of_minus(i * 0.01) / std::exp(-i * 0.01), 1, 1e-15);
    EXPECT_NEAR(minus_log((i + 1) / 10001.0), -std::log((i + 1) / 10001.0), 4e-15);
  }
}

// Through stores.

std::string build_volumes(const TempFolder& folder, const std::string& name, std::vector<std::string> scenes) {
  BuildConfig config = small_pages();
  config.scenes = std::move(scenes);
  config.output = folder / name;
  const auto report = build(config);
  EXPECT_TRUE(report.ok()) << report.status().message();
  return config.output;
}

TEST(VolumeStore, AnswersDependNeitherOnMemoryNorOnThreadsNorOnTheSchedule) {
  const TempFolder folder;
  const TestVolume fog = wavy_fog(100), surface = ball(64, {0.5, 0.5, 0.5}, 0.4);
  const std::string store = build_volumes(
      folder, "both.mill", {write_volume_file(folder, "fog.vdb", fog), write_volume_file(folder, "ball.vdb", surface)});
  const auto report = verify(store);
  ASSERT_TRUE(report.ok()) << report.status().message();
  EXPECT_EQ(report->volumes, 2U);
  std::vector<Ray> rays = rays_through(fog, 300, 8);
  const std::vector<Ray> more = rays_through(surface, 300, 9);
  rays.insert(rays.end(), more.begin(), more.end());
  rays[3].dir = {0, 0, 0};
  for (const auto& [query, config] :
       {std::pair(Query::transmittance, VolumeConfig()), std::pair(Query::transmittance, march(0.05)),
        std::pair(Query::transmittance, ratio(3)), std::pair(Query::closest, VolumeConfig()),
        std::pair(Query::any, VolumeConfig())}) {
    TraceSetup setup;
    setup.trace.query = query;
    setup.trace.volume = config;
    const Traced plenty = trace(store, rays, setup);
    ASSERT_TRUE(plenty.status.ok()) << plenty.status.message();
    EXPECT_TRUE(std::isnan(plenty.hits[3].t));
    const Traced least = trace_with_least_memory(store, rays, setup);
    EXPECT_GT(least.stats.evictions, 0U);
    EXPECT_EQ(least.rows, plenty.rows) << least.status.message();
    setup.engine.threads = 3;
    EXPECT_EQ(trace(store, rays, setup).rows, plenty.rows);
    setup.engine.eviction = "demand";
    setup.engine.adversarial = true;
    EXPECT_EQ(trace(store, std::span(rays).first(30), setup).rows, plenty.rows.substr(0, plenty.rows.size() / 20));
  }
}

TEST(VolumeStore, SpansDependNeitherOnMemoryNorOnThreadsNorOnTheSchedule) {
  const TempFolder folder;
  const TestVolume fog = wavy_fog(100), other = wavy_fog(60);
  const std::string store = build_volumes(
      folder, "two.mill", {write_volume_file(folder, "fog.vdb", fog), write_volume_file(folder, "other.vdb", other)});
  std::vector<Ray> rays = rays_through(fog, 400, 10);
  rays[3].dir = {0, 0, 0};
  TraceSetup setup;
  setup.trace.query = Query::spans;
  setup.trace.volume.threshold = 0.3;
  const Traced plenty = trace(store, rays, setup);
  ASSERT_TRUE(plenty.status.ok()) << plenty.status.message();
  ASSERT_EQ(plenty.offsets.size(), rays.size() + 1);
  EXPECT_EQ(plenty.offsets[4], plenty.offsets[3]) << "an invalid ray has none";
  EXPECT_EQ(plenty.stats.crossings, plenty.hits.size());
  std::uint64_t of_other = 0;
  for (std::size_t ray = 0; ray < rays.size(); ++ray) {
    for (std::size_t i = plenty.offsets[ray]; i < plenty.offsets[ray + 1]; ++i) {
      of_other += plenty.hits[i].geometry_id;
      EXPECT_TRUE(i == plenty.offsets[ray] || plenty.hits[i - 1].t <= plenty.hits[i].t);
    }
  }
  EXPECT_GT(of_other, 50U);
  EXPECT_GT(plenty.hits.size() - of_other, 50U);

  TraceSetup varied = setup;
  const Traced least = trace_with_least_memory(store, rays, varied);
  EXPECT_GT(least.stats.evictions, 0U);
  EXPECT_EQ(least.rows, plenty.rows) << least.status.message();
  EXPECT_EQ(least.offsets, plenty.offsets);
  varied.engine.threads = 3;
  EXPECT_EQ(trace(store, rays, varied).rows, plenty.rows);
  varied.engine.adversarial = true;
  EXPECT_EQ(trace(store, std::span(rays).first(20), varied).rows, plenty.rows.substr(0, 12 * plenty.offsets[20]));

  setup.trace.first = 1;
  const Traced first = trace(store, rays, setup);
  for (std::size_t ray = 0; ray < rays.size(); ++ray) {
    const bool any = plenty.offsets[ray] < plenty.offsets[ray + 1];
    ASSERT_EQ(first.offsets[ray + 1] - first.offsets[ray], any ? 1U : 0U);
    EXPECT_TRUE(!any || first.hits[first.offsets[ray]].u == plenty.hits[plenty.offsets[ray]].u);
  }
  setup.trace.first = 0;
  setup.trace.mask = 1;
  setup.trace.geometry_masks = std::make_shared<const std::vector<std::uint32_t>>(std::vector<std::uint32_t>{2, 1});
  EXPECT_EQ(trace(store, rays, setup).hits.size(), of_other) << "the mask leaves the first fog out";
}

TEST(VolumeStore, NearestOfTrianglesAndLevelSetsWins) {
  const TempFolder folder;
  const TestVolume surface = ball(32, {0.5, 0.5, 0.5}, 0.25);
  const Mesh wall = {Corners{Vec3f{0.5F, -9, -9}, Vec3f{0.5F, 9, -9}, Vec3f{0.5F, 0, 18}}};
  write_file(folder / "wall.glb", glb({wall}));
  const std::string store =
      build_volumes(folder, "both.mill", {folder / "wall.glb", write_volume_file(folder, "ball.vdb", surface)});
  std::vector<Ray> rays(3);
  for (Ray& ray : rays) {
    ray.org = {-1, 0.5F, 0.5F};
    ray.dir = {1, 0, 0};
  }
  rays[1].org[1] = 0.9F;  // beside the ball
  rays[2].org[0] = 2;
  rays[2].dir[0] = -1;
  rays[2].tfar = 1.2F;  // ends before the ball, from the other side
  for (const bool adversarial : {false, true}) {
    TraceSetup setup;
    setup.engine.adversarial = adversarial;
    const Traced closest = trace(store, rays, setup);
    ASSERT_TRUE(closest.status.ok()) << closest.status.message();
    EXPECT_EQ(closest.hits[0].geometry_id, 1U);
    EXPECT_NEAR(closest.hits[0].t, 1.25, 1e-3);
    EXPECT_NEAR(closest.hits[0].normal[0], -1, 1e-2);
    EXPECT_EQ(closest.hits[1].geometry_id, 0U);
    EXPECT_NEAR(closest.hits[1].t, 1.5, 1e-6);
    EXPECT_EQ(closest.hits[2].geometry_id, kNoId);
    setup.trace.geometry_masks = std::make_shared<const std::vector<std::uint32_t>>(std::vector<std::uint32_t>{1, 2});
    setup.trace.mask = 1;
    EXPECT_EQ(trace(store, rays, setup).hits[0].geometry_id, 0U) << "the mask leaves the level set out";
  }
  TraceSetup fog;
  fog.trace.query = Query::transmittance;
  EXPECT_EQ(trace(store, rays, fog).status.code(), ErrorCode::invalid_argument) << "there is none";
}

TEST(VolumeStore, AStreamThatIsCutIsBadInputAndLeavesNothing) {
  const TempFolder folder;
  BuildConfig config = small_pages();
  config.output = folder / "fog.mill";
  for (const std::size_t cut_bytes : {1UL, 32UL, 5000UL}) {
    config.scenes = {write_volume_file(folder, "fog.vdb", wavy_fog(40), cut_bytes)};
    const auto report = build(config);
    EXPECT_EQ(report.status().code(), ErrorCode::bad_scene);
    EXPECT_NE(report.status().message().find("fog.vdb"), std::string::npos);
    EXPECT_FALSE(std::filesystem::exists(config.output));
  }
}

TEST(VolumeStore, AStoreWithoutVolumesHasNoneOfTheirBytes) {
  const TempFolder folder;
  const std::string store =
      build_store(folder, "plain.mill", {{Corners{Vec3f{0, 0, 0}, Vec3f{1, 0, 0}, Vec3f{0, 1, 0}}}});
  Ledger ledger(gibibytes(1));
  const auto file = StoreFile::open(store, ledger);
  ASSERT_TRUE(file.ok());
  EXPECT_FALSE((*file)->has_volumes());
  EXPECT_EQ((*file)->footer().volume_page, 0U);
  EXPECT_EQ((*file)->page_count(), 1U);
}

}  // namespace
}  // namespace raymill::tests
