// Scenes far from the world's zero, and float64 rays: a store with an origin gives the bits that the same scene gives
// about zero, whatever way the rays come in.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"
#include "traversal/ray_rounding.h"

namespace raymill {
namespace {

using tests::Random;
using tests::TempFolder;
using tests::Traced;

constexpr std::array<double, 3> kPlace = {4510336.5, -3200768.25, 5e8};
constexpr double kFarGrid = 0x1p-20;  // of coordinates that float64 holds at kPlace too
constexpr double kInfinity64 = std::numeric_limits<double>::infinity();
constexpr double kNan64 = std::numeric_limits<double>::quiet_NaN();

Ray64 in_world(const Ray& ray) {
  return {.org = {kPlace[0] + ray.org[0], kPlace[1] + ray.org[1], kPlace[2] + ray.org[2]},
          .tnear = ray.tnear,
          .dir = {ray.dir[0], ray.dir[1], ray.dir[2]},
          .tfar = ray.tfar};
}

struct FarWay {
  std::string layout = "auto";
  Mode mode = Mode::watertight;
  bool relative = false;
  bool adversarial = false;
  unsigned threads = 1;
};

class FarTest : public testing::Test {
 protected:
  FarTest() {
    Random random(1);
    scene_ = tests::snapped({tests::soup(random, 1500, 0.2F), tests::sphere({}, 0.8F, 10, 16)}, -20);
    rays_ = tests::mixed_rays(random, scene_, 2000);
    for (Ray& ray : rays_) {
      for (float& x : ray.org) {
        x = static_cast<float>(std::nearbyint(x / kFarGrid) * kFarGrid);
      }
      wide_.push_back(in_world(ray));
    }
    near_ = write("near.mill", "none");
    far_ = write("far.mill", "4510336.5,-3200768.25,5e8");
  }

  // The scene about zero, or where the origin is.
  std::string write(const std::string& name, const std::string& origin) {
    BuildConfig config = tests::small_pages();
    config.output = folder_ / name;
    config.origin = origin;
    auto writer = StoreWriter::create(config);
    EXPECT_TRUE(writer) << writer.status().message();
    for (const tests::Mesh& mesh : scene_) {
      std::vector<double> positions;
      for (const tests::Corners& corners : mesh) {
        for (const auto& p : corners) {
          for (int axis = 0; axis < 3; ++axis) {
            positions.push_back((origin == "none" ? 0 : kPlace[std::size_t(axis)]) + p[axis]);
          }
        }
      }
      EXPECT_TRUE(writer->add({.name = "mesh", .positions64 = positions}).ok());
    }
    const auto report = writer->finish();
    EXPECT_TRUE(report) << report.status().message();
    return config.output;
  }

  template <typename Push>
  static Traced trace(const std::string& path, const FarWay& way, const Push& push) {
    EngineConfig config;
    config.memory = gibibytes(8);
    config.layout = way.layout;
    config.threads = way.threads;
    config.adversarial = way.adversarial;
    auto engine = Engine::create(config);
    auto store = (*engine)->open(path);
    EXPECT_TRUE(store) << store.status().message();
    auto job = (*store)->trace({.mode = way.mode, .fields = Field::all, .relative = way.relative});
    EXPECT_TRUE(push(**job).ok());
    return tests::run_job(**job, {});
  }
  Traced trace64(const std::string& path, const FarWay& way = {}) const {
    return trace(path, way, [this](Job& job) { return job.push64(wide_); });
  }

  const TempFolder folder_;
  tests::Scene scene_;
  std::vector<Ray> rays_;
  std::vector<Ray64> wide_;
  std::string near_, far_;
};

TEST_F(FarTest, AnswersAsTheSameSceneAboutZero) {
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    const auto push = [this](Job& job) { return job.push(rays_); };
    const Traced near = trace(near_, {.mode = mode}, push);
    EXPECT_GT(near.stats.hits, 200u);
    EXPECT_GT(near.stats.invalid, 5u);
    for (const char* layout : {"compact", "expanded"}) {
      EXPECT_TRUE(trace64(far_, {.layout = layout, .mode = mode, .threads = 2}).rows == near.rows) << layout;
      const Traced relative = trace(far_, {.layout = layout, .mode = mode, .relative = true}, push);
      EXPECT_TRUE(relative.rows == near.rows) << layout;
    }
    EXPECT_TRUE(trace64(far_, {.mode = mode, .adversarial = true}).rows == near.rows);
  }
}

// They are where their float32 says, which is not where the scene was aimed at.
TEST_F(FarTest, WorldRaysOfFloat32AreMovedExactly) {
  std::vector<Ray> narrow;
  std::vector<Ray64> same;
  for (const Ray64& ray : wide_) {
    narrow.push_back(traversal::round_ray(ray));
    const auto& org = narrow.back().org;
    same.push_back(ray);
    same.back().org = {org[0], org[1], org[2]};
  }
  const Traced moved = trace(far_, {}, [&](Job& job) { return job.push(narrow); });
  const Traced wide = trace(far_, {}, [&](Job& job) { return job.push64(same); });
  EXPECT_TRUE(moved.rows == wide.rows);
  EXPECT_TRUE(moved.rows != trace64(far_).rows) << "float32 has steps of 64 here";
}

TEST_F(FarTest, BothKindsOfRaysMayBePushedInTurn) {
  const Traced whole = trace64(far_);
  const Traced mixed = trace(far_, {.relative = true}, [&](Job& job) {
    std::vector<Ray64> some;
    for (const Ray& ray : std::span(rays_).subspan(1000)) {
      some.push_back({.org = {ray.org[0], ray.org[1], ray.org[2]},
                      .tnear = ray.tnear,
                      .dir = {ray.dir[0], ray.dir[1], ray.dir[2]},
                      .tfar = ray.tfar});
    }
    const Status status = job.push(std::span(rays_).first(1000));
    return status.ok() ? job.push64(some) : status;
  });
  EXPECT_TRUE(mixed.rows == whole.rows);
}

TEST_F(FarTest, InfoSaysWhereTheStoreLies) {
  EngineConfig config;
  const auto engine = Engine::create(config);
  const auto info = (*(*engine)->open(far_))->info();
  ASSERT_TRUE(info);
  EXPECT_EQ(info->origin, kPlace);
  EXPECT_EQ(info->features.back(), "origin");
  EXPECT_GE(info->bounds_min[0], -1.2F);
  EXPECT_LE(info->bounds_max[0], 1.2F);
  EXPECT_EQ((*(*engine)->open(near_))->info()->origin, (std::array<double, 3>{}));
}

// Extras come with rays of float64 as with others.
TEST_F(FarTest, WideRaysBringExtras) {
  EngineConfig config;
  const auto engine = Engine::create(config);
  const auto store = *(*engine)->open(far_);
  const Traced first = trace64(far_);
  std::vector<PrimitiveIds> skipped;
  for (const Hit& hit : first.hits) {
    skipped.push_back({hit.geometry_id, hit.primitive_id});
  }
  auto job = store->trace({.fields = Field::all, .skips = true});
  ASSERT_TRUE((*job)->push64(wide_, {.skipped = skipped}).ok());
  EXPECT_EQ((*job)->push64(wide_, {.skipped = std::span(skipped).subspan(1)}).code(), ErrorCode::invalid_argument);
  const Traced second = tests::run_job(**job, {});
  std::size_t further = 0;
  for (std::size_t i = 0; i < second.hits.size(); ++i) {
    const Hit &a = first.hits[i], &b = second.hits[i];
    EXPECT_TRUE(b.primitive_id == kNoId || a.primitive_id != b.primitive_id || a.geometry_id != b.geometry_id);
    further += std::isfinite(b.t) ? 1 : 0;
  }
  EXPECT_GT(further, 50u);
}

// What float64 holds and float32 does not, and what neither takes for a ray.
TEST_F(FarTest, HostileNumbersOfFloat64AreNamed) {
  const Ray64 good = wide_[0];
  struct Case {
    Ray64 ray;
    bool valid = true;
  };
  std::vector<Case> cases = {{good, true}};
  const auto add = [&](auto&& change, bool valid) {
    cases.push_back({good, valid});
    change(cases.back().ray);
    cases.push_back({good, true});
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const double bad : {kNan64, kInfinity64, -kInfinity64, 1e300, -1e39}) {
      add([&](Ray64& ray) { ray.org[axis] = bad; }, false);
      add([&](Ray64& ray) { ray.dir[axis] = bad; }, false);
    }
    add([&](Ray64& ray) { ray.org[axis] = 5e-324; }, true);
    add([&](Ray64& ray) { ray.org[axis] = -3e38; }, true);
  }
  add([&](Ray64& ray) { ray.dir = {0, -0.0, 0}; }, false);
  add([&](Ray64& ray) { ray.dir = {5e-324, -1e-300, 1e-60}; }, false);
  add([&](Ray64& ray) { ray.dir = {1e-45, 0, 1e-300}; }, true);
  add([&](Ray64& ray) { ray.dir = {3e38, -3e38, 1e-310}; }, true);
  add([&](Ray64& ray) { ray.tnear = kNan64; }, false);
  add([&](Ray64& ray) { ray.tfar = kNan64; }, false);
  add([&](Ray64& ray) { ray.tnear = 2, ray.tfar = std::nextafter(2.0, 0.0); }, false);
  add([&](Ray64& ray) { ray.tnear = -kInfinity64, ray.tfar = kInfinity64; }, true);
  add([&](Ray64& ray) { ray.tnear = -1e300, ray.tfar = 1e300; }, true);
  add([&](Ray64& ray) { ray.tnear = 5e-324, ray.tfar = 5e-324; }, true);
  add([&](Ray64& ray) { ray.tnear = kInfinity64, ray.tfar = kInfinity64; }, true);
  std::vector<Ray64> rays;
  for (const Case& one : cases) {
    rays.push_back(one.ray);
  }
  for (const std::string& path : {near_, far_}) {
    for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
      const auto push = [&](Job& job) { return job.push64(rays); };
      const Traced traced = trace(path, {.mode = mode}, push);
      ASSERT_TRUE(traced.status.ok());
      ASSERT_EQ(traced.hits.size(), cases.size());
      for (std::size_t i = 0; i < cases.size(); ++i) {
        EXPECT_EQ(std::isnan(traced.hits[i].t), !cases[i].valid) << path << ", case " << i;
        EXPECT_TRUE(i % 2 == 1 || tests::same_bits(traced.hits[i], traced.hits[0])) << "beside case " << i;
      }
#if defined(__x86_64__)
      const unsigned control = __builtin_ia32_stmxcsr();
      __builtin_ia32_ldmxcsr(control | 0x8040 | 0x6000);  // flush to zero, denormals are zero, round towards zero
      const Traced flushed = trace(path, {.mode = mode}, push);
      __builtin_ia32_ldmxcsr(control);
      EXPECT_TRUE(traced.rows == flushed.rows);
#endif
    }
  }
}

// From 1e-30 to 1e18, and 1e7 times their size from zero, as float32 and as float64 about an origin.
TEST_F(FarTest, ScenesOfEverySizeAreAnsweredAlike) {
  Random random(7);
  const auto mesh = tests::snapped({tests::sphere({}, 1, 8, 12)}, -16)[0];
  std::vector<Ray> rays;
  for (const auto& vertex : tests::vertices_of(mesh)) {
    rays.push_back(tests::ray({}, vertex));
    rays.push_back(tests::ray({0.25F, -0.5F, 0.125F}, random.direction()));
  }
  std::string unit;
  for (const int exponent : {0, -100, -60, 20, 60}) {  // 2^-100 is 8e-31, 2^60 1.2e18
    const float scale = std::ldexp(1.0F, exponent);
    for (const double offset : {0.0, std::ldexp(10000000.0, exponent)}) {
      std::vector<double> positions;
      std::vector<Ray64> wide;
      for (const tests::Corners& corners : mesh) {
        for (const auto& p : corners) {
          positions.insert(positions.end(),
                           {offset + double(p.x) * scale, double(p.y) * scale - offset, double(p.z) * scale + offset});
        }
      }
      for (const Ray& ray : rays) {
        wide.push_back({.org = {offset + double(ray.org[0]) * scale, double(ray.org[1]) * scale - offset,
                                double(ray.org[2]) * scale + offset},
                        .dir = {double(ray.dir[0]) * scale, double(ray.dir[1]) * scale, double(ray.dir[2]) * scale}});
      }
      BuildConfig config = tests::small_pages();
      config.output = folder_ / ("scale" + std::to_string(exponent) + (offset > 0 ? "far" : "") + ".mill");
      char text[128];
      std::snprintf(text, sizeof text, "%.17g,%.17g,%.17g", offset, -offset, offset);
      config.origin = offset > 0 ? text : "none";
      auto writer = StoreWriter::create(config);
      ASSERT_TRUE(writer && writer->add({.name = "sphere", .positions64 = positions}).ok());
      ASSERT_TRUE(writer->finish());
      const Traced traced = trace(config.output, {.mode = Mode::exact}, [&](Job& job) { return job.push64(wide); });
      EXPECT_EQ(traced.stats.hits, rays.size()) << "2^" << exponent << ", offset " << offset;
      unit = unit.empty() ? traced.rows : unit;
      EXPECT_TRUE(traced.rows == unit) << "2^" << exponent << ", offset " << offset;
    }
  }
}

}  // namespace
}  // namespace raymill
