// raymill-offset: a relief of one-millimetre steps 6400 km from the world's zero, and three in one store that lie up to
// 10 000 km apart (towns.h), met by float64 rays.
//
//   raymill-offset [--rays N]          runs it and prints the page's lines
//   raymill-offset --write PAGE.md     writes the page
//   raymill-offset --check PAGE.md     fails where the page says anything else; Embree's lines are left out
//
// The truth is quadruple precision (relief.h). Exit codes: 0; 1 an error is beyond its bound, bits differ between ways
// to bring the rays, or the page is out of date; 2 it could not be run.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>

#include "client/cli/bench/embree_scene.h"
#include "tests/extremes/relief.h"
#include "tests/extremes/towns.h"
#include "tests/support/random.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/tool.h"
#include "traversal/engine.h"
#include "traversal/ray_rounding.h"

namespace raymill::extremes {
namespace {

// 6400 km from zero, and no multiple of anything.
constexpr Point kPlace = {3695041.7231839, 3695040.0194531, -3695044.2718281};

constexpr const char* kHead = R"(# A millimetre, 6400 km out

A relief of %u triangles whose corners are 1 mm apart and 0 to 3 mm high, in float64 at (3695041.72, 3695040.02,
-3695044.27), and %zu float64 rays for each line from so far above it, up to 55 degrees off the upright. The truth is
quadruple precision on the same numbers. A wrong hit is a hit for a miss or a miss for a hit, a wrong triangle another
one than the true; lengths are in metres: how far t is off, times the length of dir, and how far the point `org + t dir` lies
from the true one and from the plane of the triangle that it was said to lie on. Where a ray grazes a slope, or comes down on
the other side of a ridge, t is off by more than the ray is. The bound is for the last column: %s.

With an origin in the store, which `--origin auto` gives such a scene, the relief is kept relative to a point near by; rays
come to it in float64, exactly, before they are rounded (traversal/ray_rounding.h). Without one (`--origin none`) corners
are rounded where they are, to a quarter of a metre: no triangle is left with an area, and `raymill build` says so. Embree
has such corners and rays, for it takes no others.

`raymill-offset --write tests/extremes/offset.md` makes the page again; a test compares it, but for Embree's lines.

| from | who | wrong hits | wrong triangles | t off, median | t off, most | point off, most | off the surface, most |
|---|---|---|---|---|---|---|---|
)";

class Offset {
 public:
  explicit Offset(std::size_t rays) : count_(rays), relief_(make_relief(random_, kPlace)) {}

  Status run() {
    RAYMILL_RETURN_IF_ERROR(build("relief.mill", "auto"));
    if (build("world.mill", "none").code() != ErrorCode::bad_scene) {
      fail("in world space float32 should leave no triangle that has an area");
    }
    for (const double distance : {0.1, 1.0, 10.0, 1000.0}) {
      rays_ = make_rays(random_, kPlace, distance, count_);
      truths_.clear();
      std::transform(rays_.begin(), rays_.end(), std::back_inserter(truths_),
                     [this](const Ray64& ray) { return true_hit(relief_, ray); });
      for (const Mode mode : {Mode::fast, Mode::watertight, Mode::exact}) {
        RAYMILL_ASSIGN_OR_RETURN(const std::vector<Hit> hits, trace("relief.mill", mode));
        judge(distance, mode, hits);
      }
      RAYMILL_RETURN_IF_ERROR(embree(distance));
    }
    return {};
  }
  [[nodiscard]] const std::string& lines() const { return lines_; }
  [[nodiscard]] bool passed() const { return passed_; }
  /// Of the point from the surface: rounding of the ray, of t and of the corners to float32.
  static double bound(double distance) { return 8 * (2 * distance + 1) * 0x1p-24; }

 private:
  static std::string from(double distance) {
    char text[32];
    std::snprintf(text, sizeof text, "%g m", distance);
    return text;
  }
  void tell(const std::string& line) {
    lines_ += line;
    std::printf("%s", line.c_str());
    std::fflush(stdout);
  }
  void fail(const std::string& what) {
    std::printf("FAILED: %s\n", what.c_str());
    passed_ = false;
  }

  // As a PLY of float64, which is what such scenes come in.
  Status build(const std::string& name, const std::string& origin) const {
    std::ostringstream ply;
    ply << "ply\nformat binary_little_endian 1.0\nelement vertex " << relief_.positions.size() / 3
        << "\nproperty double x\nproperty double y\nproperty double z\nelement face " << relief_.triangles()
        << "\nproperty list uchar uint vertex_indices\nend_header\n";
    ply.write(reinterpret_cast<const char*>(relief_.positions.data()),
              std::streamsize(relief_.positions.size() * sizeof(double)));
    for (std::size_t i = 0; i < relief_.triangles(); ++i) {
      ply.put(3);
      ply.write(reinterpret_cast<const char*>(&relief_.indices[3 * i]), 3 * sizeof(std::uint32_t));
    }
    const std::string scene = folder_ / "relief.ply";
    tests::write_file(scene, ply.str());
    BuildConfig config = tests::small_pages();
    config.scenes = {scene};
    config.output = folder_ / name;
    config.origin = origin;
    return raymill::build(config).status();
  }

  Result<std::vector<Hit>> trace(const std::string& name, Mode mode) {
    EngineConfig config;
    config.memory = gibibytes(1);
    RAYMILL_ASSIGN_OR_RETURN(const auto engine, Engine::create(config));
    RAYMILL_ASSIGN_OR_RETURN(const auto store, engine->open(folder_ / name));
    RAYMILL_ASSIGN_OR_RETURN(const auto origin, store->origin());
    std::vector<Ray> rounded;
    std::transform(rays_.begin(), rays_.end(), std::back_inserter(rounded),
                   [&](const Ray64& ray) { return traversal::round_ray(ray, origin); });
    RAYMILL_ASSIGN_OR_RETURN(const auto hits, answers(*store, {.mode = mode, .fields = Field::all},
                                                      [this](Job& job) { return job.push64(rays_); }));
    RAYMILL_ASSIGN_OR_RETURN(const auto relative,
                             answers(*store, {.mode = mode, .fields = Field::all, .relative = true},
                                     [&](Job& job) { return job.push(rounded); }));
    const auto same = [](const Hit& a, const Hit& b) { return tests::same_bits(a, b); };
    if (!std::equal(hits.begin(), hits.end(), relative.begin(), relative.end(), same)) {
      fail("rays that were rounded before give other bits");
    }
    return hits;
  }

  static Result<std::vector<Hit>> answers(Store& store, const TraceConfig& config,
                                          const std::function<Status(Job&)>& push) {
    RAYMILL_ASSIGN_OR_RETURN(const auto job, store.trace(config));
    RAYMILL_RETURN_IF_ERROR(push(*job));
    RAYMILL_RETURN_IF_ERROR(job->finish());
    std::vector<Hit> hits;
    while (const auto chunk = job->next()) {
      for (std::size_t i = 0; i < chunk->size(); ++i) {
        hits.push_back(chunk->hit(i));
      }
    }
    RAYMILL_RETURN_IF_ERROR(job->status());
    return hits;
  }

  void judge(double distance, Mode mode, std::span<const Hit> hits) {
    const Errors errors = errors_of(relief_, rays_, truths_, hits);
    const std::string who(to_string(mode));
    tell(line_of(from(distance), who, errors));
    if (mode != Mode::fast && errors.most_off > bound(distance)) {
      fail(who + " from " + std::to_string(distance) + " m is off the surface by more than its bound");
    }
    // The relief is closed where the rays go: none may pass.
    if (mode != Mode::fast && errors.wrong_hits > 0) {
      fail(who + " from " + std::to_string(distance) + " m has wrong hits");
    }
  }

  Status embree(double distance) {
    std::vector<tests::Triangle> triangles(relief_.triangles());
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) {
        const double* p = &relief_.positions[3 * std::size_t{relief_.indices[3 * i + k]}];
        triangles[i].v[k] = {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])};
      }
      triangles[i].primitive_id = static_cast<std::uint32_t>(i);
    }
    RAYMILL_ASSIGN_OR_RETURN(const auto scene,
                             client::EmbreeScene::create(
                                 {.robust = true}, [&](storage::TriangleSink& sink) { return sink.add(triangles); }));
    std::vector<Hit> hits;
    std::transform(rays_.begin(), rays_.end(), std::back_inserter(hits),
                   [&](const Ray64& ray) { return scene.closest_hit(traversal::round_ray(ray)); });
    tell(line_of(from(distance), "Embree, robust", errors_of(relief_, rays_, truths_, hits)));
    return {};
  }

  const std::size_t count_;
  tests::Random random_{6400};
  const Relief relief_;
  const tests::TempFolder folder_;
  std::vector<Ray64> rays_;
  std::vector<Truth> truths_;
  std::string lines_;
  bool passed_ = true;
};

std::string without_embree(const std::string& page) {
  std::istringstream text(page);
  std::string kept;
  for (std::string line; std::getline(text, line);) {
    kept += line.find("| Embree") == std::string::npos ? line + "\n" : "";
  }
  return kept;
}

int main(int argc, char** argv) {
  tests::Tool tool("raymill-offset", "A relief of one-millimetre steps 6400 km out, by float64 rays.");
  std::size_t rays = 2000;
  std::string write, check;
  tool.option("--rays", rays, "For each line");
  tool.option("--write", write, "Write the page").type("PAGE.md");
  tool.option("--check", check, "Compare the page, but for Embree's lines").type("PAGE.md");
  return tool.run(argc, argv, [&]() -> Result<bool> {
    Offset offset(rays);
    RAYMILL_RETURN_IF_ERROR(offset.run());
    char head[4096];
    std::snprintf(head, sizeof head, kHead, 2 * Relief::kCells * Relief::kCells, rays,
                  "8 (2 D + 1 m) 2^-24 from D metres, 1.4 micrometres at 1 m, for `watertight` and `exact`");
    RAYMILL_ASSIGN_OR_RETURN(const TownsPage towns, run_towns(rays / 4));
    const std::string page = head + offset.lines() + towns.text;
    if (!write.empty() && !(std::ofstream(write) << page)) {
      return {ErrorCode::io, "cannot write " + write};
    }
    std::ifstream file(check);
    const std::string kept((std::istreambuf_iterator<char>(file)), {});
    if (!check.empty() && without_embree(kept) != without_embree(page)) {
      std::printf("%s is out of date\n", check.c_str());
      return false;
    }
    return offset.passed() && towns.passed;
  });
}

}  // namespace
}  // namespace raymill::extremes

int main(int argc, char** argv) { return raymill::extremes::main(argc, argv); }
