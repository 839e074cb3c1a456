// Stores whose parts lie so far apart that no origin serves all: rays of float64 find each as if it lay about zero.
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"

namespace raymill {
namespace {

using tests::Random;
using tests::TempFolder;
using tests::Traced;
using Place = std::array<double, 3>;

// Ten thousand kilometres apart, and the middle; multiples of kWideGrid, as all coordinates are.
constexpr std::array<Place, 3> kPlaces = {
    {{-5000000.71875, 1234.0625, 3.03125}, {0.34375, -0.125, 0.5}, {5000000.40625, -77.96875, -4999999.84375}}};
constexpr double kWideGrid = 0x1p-20;

struct WideWay {
  std::string isa = {};
  Mode mode = Mode::watertight;
  Query query = Query::closest;
  bool adversarial = false;
  unsigned threads = 1;
};

class WideTest : public testing::Test {
 protected:
  WideTest() {
    Random random(7);
    scene_ = tests::snapped({tests::soup(random, 700, 0.2F), tests::sphere({}, 0.8F, 10, 16)}, -20);
    for (Ray& ray : rays_ = tests::mixed_rays(random, scene_, 1000)) {
      for (float& x : ray.org) {
        x = static_cast<float>(std::nearbyint(x / kWideGrid) * kWideGrid);
      }
    }
    // So near that they begin in the boxes, which have room for what float32 leaves of org: t is the triangle's alone.
    std::erase_if(rays_, [](const Ray& ray) {
      return std::any_of(ray.org.begin(), ray.org.end(), [](float x) { return !(std::fabs(x) < 1.5F); });
    });
  }

  // The scene about zero, or as an object that is placed three times.
  std::string write(const std::string& name, const std::string& origins, unsigned width, bool placed) {
    BuildConfig config = tests::small_pages();
    config.output = folder_ / name;
    config.origins = origins;
    config.width = width;
    auto writer = StoreWriter::create(config);
    EXPECT_TRUE(writer) << writer.status().message();
    std::vector<std::vector<float>> positions;
    std::vector<MeshView> meshes;
    for (const tests::Mesh& mesh : scene_) {
      std::vector<float>& numbers = positions.emplace_back();
      for (const tests::Corners& corners : mesh) {
        for (const auto& p : corners) {
          numbers.insert(numbers.end(), {p.x, p.y, p.z});
        }
      }
    }
    for (const std::vector<float>& numbers : positions) {
      meshes.push_back({.name = "mesh", .positions = numbers});
    }
    if (placed) {
      const auto object = writer->add_object(meshes);
      for (const Place& p : kPlaces) {
        EXPECT_TRUE(writer->place(*object, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, p[0], p[1], p[2], 1}).ok());
      }
    } else {
      for (const MeshView& mesh : meshes) {
        EXPECT_TRUE(writer->add(mesh).ok());
      }
    }
    const auto report = writer->finish();
    EXPECT_TRUE(report) << report.status().message();
    return config.output;
  }

  [[nodiscard]] std::vector<Ray64> at(const Place& place) const {
    std::vector<Ray64> wide;
    for (const Ray& ray : rays_) {
      wide.push_back({.org = {place[0] + ray.org[0], place[1] + ray.org[1], place[2] + ray.org[2]},
                      .tnear = ray.tnear,
                      .dir = {ray.dir[0], ray.dir[1], ray.dir[2]},
                      .tfar = ray.tfar});
    }
    return wide;
  }

  template <typename Push>
  static Traced trace(const std::string& path, const WideWay& way, bool float64, const Push& push) {
    EngineConfig config;
    config.memory = gibibytes(1);
    config.isa = way.isa;
    config.threads = way.threads;
    config.adversarial = way.adversarial;
    const auto engine = Engine::create(config);
    const auto store = (*engine)->open(path);
    EXPECT_TRUE(store) << store.status().message();
    const auto job = (*store)->trace({.query = way.query, .mode = way.mode, .fields = Field::all, .float64 = float64});
    EXPECT_TRUE(job) << job.status().message();
    EXPECT_TRUE(push(**job).ok());
    return tests::run_job(**job, {});
  }

  const TempFolder folder_;
  tests::Scene scene_;
  std::vector<Ray> rays_;
};

// But for the ids of what was placed, which follow from the place, and the last digit of normals, which are made of
// length one once more.
void expect_as_near(std::vector<Hit> near, const std::vector<Hit>& far, std::size_t place) {
  ASSERT_EQ(near.size(), far.size());
  for (std::size_t i = 0; i < near.size(); ++i) {
    if (near[i].primitive_id != kNoId) {
      near[i].geometry_id += static_cast<std::uint32_t>(2 * place);
      near[i].instance_id = static_cast<std::uint32_t>(place);
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(near[i].normal[axis], far[i].normal[axis], 1e-6F);
    }
    near[i].normal = far[i].normal;
    EXPECT_TRUE(tests::same_bits(near[i], far[i])) << "ray " << i << ": " << near[i].t << ", " << far[i].t;
  }
}

TEST_F(WideTest, EachPlaceAnswersAsTheObjectAboutZero) {
  const std::string near = write("near.mill", "auto", 8, false);
  const std::string wide = write("wide.mill", "always", 8, true), narrow = write("narrow.mill", "always", 4, true);
  std::vector<WideWay> ways{{.adversarial = true}, {.threads = 3}};
  for (const std::string& isa : available_isas()) {
    ways.push_back({.isa = isa});
  }
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    const Traced expected = trace(near, {.mode = mode}, false, [&](Job& job) { return job.push(rays_); });
    EXPECT_GT(expected.stats.hits, 200u);
    for (std::size_t place = 0; place < kPlaces.size(); ++place) {
      const auto push = [&](Job& job) { return job.push64(at(kPlaces[place])); };
      for (WideWay way : ways) {
        way.mode = mode;
        expect_as_near(expected.hits, trace(wide, way, true, push).hits, place);
      }
      expect_as_near(expected.hits, trace(narrow, {.mode = mode}, true, push).hits, place);
    }
  }
}

TEST_F(WideTest, OtherQueriesAnswerAlike) {
  const std::string near = write("near.mill", "auto", 8, false), wide = write("wide.mill", "always", 8, true);
  for (const Query query : {Query::any, Query::count}) {
    const Traced expected = trace(near, {.query = query}, false, [&](Job& job) { return job.push(rays_); });
    for (const bool adversarial : {false, true}) {
      const Traced far = trace(wide, {.query = query, .adversarial = adversarial}, true,
                               [&](Job& job) { return job.push64(at(kPlaces[2])); });
      EXPECT_TRUE(far.rows == expected.rows) << to_string(query);
    }
  }
}

// Without the digits that float32 leaves, a ray misses what it was sent to.
TEST_F(WideTest, RaysOfFloat64AreToBeAskedFor) {
  const std::string wide = write("wide.mill", "always", 8, true), never = write("never.mill", "never", 8, true);
  const auto engine = Engine::create({.memory = gibibytes(1)}), other = Engine::create({.memory = gibibytes(1)});
  const auto store = (*engine)->open(wide), plain = (*other)->open(never);
  EXPECT_EQ((*store)->info()->features.back(), "origins");
  EXPECT_TRUE(*(*store)->keeps_float64());
  EXPECT_EQ((*plain)->info()->features.back(), "instances");
  EXPECT_FALSE(*(*plain)->keeps_float64());
  const std::vector<Ray64> rays = at(kPlaces[0]);
  const auto unasked = (*store)->trace({});
  EXPECT_EQ((*unasked)->push64(rays).code(), ErrorCode::invalid_argument);
  EXPECT_TRUE((*unasked)->push(rays_).ok()) << "float32 needs nothing";
  const auto push = [&](Job& job) { return job.push64(rays); };
  const Traced kept = trace(wide, {}, true, push), lost = trace(never, {}, true, push);
  std::size_t others = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    others += tests::same_bits(kept.hits[i], lost.hits[i]) ? 0 : 1;
  }
  EXPECT_GT(others, rays.size() / 2);
  EXPECT_TRUE(trace(never, {}, false, push).rows == lost.rows) << "asked for or not, where nothing is kept";
}

// Files that are not cut: the second lies 10 000 km from the first, so it is a part.
TEST_F(WideTest, AFileFarFromTheFirstIsAPart) {
  tests::write_file(folder_ / "a.obj", "v 4500000.001 0 -7\nv 4500000.002 1 -7\nv 4500000.003 0 -6\nf 1 2 3\n");
  tests::write_file(folder_ / "b.obj", "v -4500000.001 0 -7\nv -4500000.002 1 -7\nv -4500000.003 0 -6\nf 1 2 3\n");
  BuildConfig config = tests::small_pages();
  config.scenes = {folder_ / "a.obj", folder_ / "b.obj"};
  config.output = folder_ / "files.mill";
  const auto report = build(config);
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_EQ(report->parts, 1u);
  EXPECT_EQ(report->triangles, 2u);
  EXPECT_EQ(report->origin, (Place{4500000, 0, -6}));
  EXPECT_TRUE(verify(config.output));
  const std::vector<Ray64> rays{{.org = {4500000.002, 0.25, -1}, .dir = {0, 0, -1}},
                                {.org = {-4500000.002, 0.25, -1}, .dir = {0, 0, -1}}};
  const Traced traced = trace(config.output, {}, true, [&](Job& job) { return job.push64(rays); });
  EXPECT_NEAR(traced.hits[0].t, 5.5, 0.5);
  EXPECT_NEAR(traced.hits[1].t, traced.hits[0].t, 1e-6);
  EXPECT_EQ(traced.hits[0].geometry_id, 0u);
  EXPECT_EQ(traced.hits[1].geometry_id, 1u);
  config.origins = "never";
  EXPECT_EQ(build(config)->parts, 0u);
  config.origins = "sometimes";
  EXPECT_EQ(build(config).status().code(), ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace raymill
