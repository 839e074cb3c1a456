// raymill-offset: a relief of one-millimetre steps 6400 km from the world's zero, met by float64 rays.
//
//   raymill-offset [--rays N]          runs it and prints the page's lines
//   raymill-offset --write PAGE.md     writes the page
//   raymill-offset --check PAGE.md     fails where the page says anything else; Embree's lines are left out
//
// The truth is quadruple precision on the very numbers that were given: corners and rays in float64, whose differences
// and products it holds without loss. Exit codes: 0; 1 an error is beyond its bound, bits differ between ways to bring
// the rays, or the page is out of date; 2 it could not be run.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <optional>
#include <sstream>

#include "client/cli/bench/embree_scene.h"
#include "tests/support/random.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/tool.h"
#include "traversal/engine.h"
#include "traversal/ray_rounding.h"

namespace raymill::extremes {
namespace {

__extension__ using Quad = __float128;
using Point = std::array<double, 3>;
using QuadPoint = std::array<Quad, 3>;

constexpr unsigned kCells = 120;      // along a side
constexpr double kMillimetre = 1e-3;  // of a cell, and of a step up or down
// 6400 km from zero, and no multiple of anything.
constexpr Point kPlace = {3695041.7231839, 3695040.0194531, -3695044.2718281};

// The relief: corner (i, j) stands 0 to 3 mm high. Float64, in world space.
struct Relief {
  std::vector<double> positions;
  std::vector<std::uint32_t> indices;

  [[nodiscard]] Point corner(std::size_t triangle, std::size_t k) const {
    const std::size_t at = 3 * std::size_t{indices[3 * triangle + k]};
    return {positions[at], positions[at + 1], positions[at + 2]};
  }
  [[nodiscard]] std::size_t triangles() const { return indices.size() / 3; }
};

Relief make_relief(tests::Random& random) {
  Relief relief;
  for (unsigned j = 0; j <= kCells; ++j) {
    for (unsigned i = 0; i <= kCells; ++i) {
      relief.positions.insert(relief.positions.end(), {kPlace[0] + i * kMillimetre, kPlace[1] + j * kMillimetre,
                                                       kPlace[2] + random.below(4) * kMillimetre});
    }
  }
  for (unsigned j = 0; j < kCells; ++j) {
    for (unsigned i = 0; i < kCells; ++i) {
      const unsigned a = j * (kCells + 1) + i, b = a + 1, c = a + kCells + 1, d = c + 1;
      relief.indices.insert(relief.indices.end(), {a, b, d, a, d, c});
    }
  }
  return relief;
}

// From `distance` away, at most 60 degrees off the upright, at a point of the relief's middle; dir is as long as the
// way.
std::vector<Ray64> make_rays(tests::Random& random, double distance, std::size_t count) {
  std::vector<Ray64> rays;
  while (rays.size() < count) {
    const auto share = [&] { return double(random.uniform(-1, 1)); };
    const double along = 0.06 + 0.05 * share(), across = 0.06 + 0.05 * share();
    const Point target = {kPlace[0] + along, kPlace[1] + across, kPlace[2] + 0.0015};
    const Point from = {target[0] + distance * share(), target[1] + distance * share(), target[2] + distance};
    rays.push_back({.org = from, .dir = {target[0] - from[0], target[1] - from[1], target[2] - from[2]}, .tfar = 1e30});
  }
  return rays;
}

QuadPoint operator-(const QuadPoint& a, const QuadPoint& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
QuadPoint quad(const Point& p) { return {p[0], p[1], p[2]}; }
Quad dot(const QuadPoint& a, const QuadPoint& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
QuadPoint cross(const QuadPoint& a, const QuadPoint& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

struct Truth {
  std::size_t triangle = 0;
  Quad t = -1;  // none
};

// Moeller and Trumbore in quadruple precision.
std::optional<Quad> true_t(const Relief& relief, std::size_t triangle, const Ray64& ray) {
  const QuadPoint a = quad(relief.corner(triangle, 0));
  const QuadPoint e1 = quad(relief.corner(triangle, 1)) - a, e2 = quad(relief.corner(triangle, 2)) - a;
  const QuadPoint dir = quad(ray.dir), s = quad(ray.org) - a;
  const QuadPoint p = cross(dir, e2), q = cross(s, e1);
  const Quad det = dot(e1, p);
  const Quad u = dot(s, p) / det, v = dot(dir, q) / det, t = dot(e2, q) / det;
  const bool hits = det != 0 && u >= 0 && v >= 0 && u + v <= 1 && t >= ray.tnear && t <= ray.tfar;
  return hits ? std::optional<Quad>(t) : std::nullopt;
}

// The relief is at most 3 mm high, so that only the cells below the ray's last few millimetres can be hit.
Truth true_hit(const Relief& relief, const Ray64& ray) {
  const double top = (kPlace[2] + 4 * kMillimetre - ray.org[2]) / ray.dir[2];
  const double bottom = (kPlace[2] - kMillimetre - ray.org[2]) / ray.dir[2];
  const auto cells = [&](std::size_t axis) {
    const double a = (ray.org[axis] - kPlace[axis] + top * ray.dir[axis]) / kMillimetre;
    const double b = (ray.org[axis] - kPlace[axis] + bottom * ray.dir[axis]) / kMillimetre;
    const auto within = [](double x) { return static_cast<unsigned>(std::clamp(x, 0.0, double(kCells - 1))); };
    return std::pair(within(std::min(a, b) - 1), within(std::max(a, b) + 1));
  };
  const auto [i0, i1] = cells(0);
  const auto [j0, j1] = cells(1);
  Truth best;
  for (std::size_t j = j0; j <= j1; ++j) {
    for (std::size_t i = i0; i <= i1; ++i) {
      for (std::size_t half = 0; half < 2; ++half) {
        const std::size_t triangle = 2 * (j * kCells + i) + half;
        const auto t = true_t(relief, triangle, ray);
        if (t && (best.t < 0 || *t < best.t)) {
          best = {triangle, *t};
        }
      }
    }
  }
  return best;
}

// What somebody's hits are worth. Lengths in metres.
struct Errors {
  std::size_t rays = 0, wrong_hits = 0, wrong_triangles = 0;
  double most_t = 0, most_place = 0;
  double most_off = 0;  ///< of the point from the plane of the triangle that was said to be hit
  std::vector<double> t;

  [[nodiscard]] double median_t() {
    if (t.empty()) {
      return 0;
    }
    std::nth_element(t.begin(), t.begin() + std::ptrdiff_t(t.size() / 2), t.end());
    return t[t.size() / 2];
  }
};

// How far `p` lies off a triangle's plane.
double off_plane(const Relief& relief, std::size_t triangle, const QuadPoint& p) {
  const QuadPoint a = quad(relief.corner(triangle, 0));
  const QuadPoint n = cross(quad(relief.corner(triangle, 1)) - a, quad(relief.corner(triangle, 2)) - a);
  return std::fabs(static_cast<double>(dot(n, p - a))) / std::sqrt(static_cast<double>(dot(n, n)));
}

Errors errors_of(const Relief& relief, std::span<const Ray64> rays, std::span<const Truth> truths,
                 std::span<const Hit> hits) {
  Errors errors;
  errors.rays = rays.size();
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const bool is_hit = std::isfinite(hits[i].t);
    if (is_hit != (truths[i].t >= 0)) {
      ++errors.wrong_hits;
      continue;
    }
    if (!is_hit) {
      continue;
    }
    errors.wrong_triangles += hits[i].primitive_id != truths[i].triangle ? 1 : 0;
    const auto off = static_cast<double>(Quad(hits[i].t) - truths[i].t);
    const Point& d = rays[i].dir;
    const double length = std::sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    errors.t.push_back(std::fabs(off) * length);
    errors.most_t = std::max(errors.most_t, errors.t.back());
    // How far the point that a caller makes of t in float64 lies from the true one.
    double square = 0;
    QuadPoint point{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double ours = rays[i].org[axis] + double(hits[i].t) * d[axis];
      point[axis] = ours;
      const auto apart = static_cast<double>(Quad(ours) - (Quad(rays[i].org[axis]) + truths[i].t * d[axis]));
      square += apart * apart;
    }
    errors.most_place = std::max(errors.most_place, std::sqrt(square));
    errors.most_off = std::max(errors.most_off, off_plane(relief, hits[i].primitive_id, point));
  }
  return errors;
}

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

std::string line_of(double distance, const std::string& who, Errors errors) {
  char text[256];
  std::snprintf(text, sizeof text, "| %g m | %s | %zu of %zu | %zu | %.2g | %.2g | %.2g | %.2g |\n", distance,
                who.c_str(), errors.wrong_hits, errors.rays, errors.wrong_triangles, errors.median_t(), errors.most_t,
                errors.most_place, errors.most_off);
  return text;
}

class Offset {
 public:
  explicit Offset(std::size_t rays) : count_(rays), relief_(make_relief(random_)) {}

  Status run() {
    RAYMILL_RETURN_IF_ERROR(build("relief.mill", "auto"));
    if (build("world.mill", "none").code() != ErrorCode::bad_scene) {
      fail("in world space float32 should leave no triangle that has an area");
    }
    for (const double distance : {0.1, 1.0, 10.0, 1000.0}) {
      rays_ = make_rays(random_, distance, count_);
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
    tell(line_of(distance, who, errors));
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
        const Point p = relief_.corner(i, k);
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
    tell(line_of(distance, "Embree, robust", errors_of(relief_, rays_, truths_, hits)));
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
    std::snprintf(head, sizeof head, kHead, 2 * kCells * kCells, rays,
                  "8 (2 D + 1 m) 2^-24 from D metres, 1.4 micrometres at 1 m, for `watertight` and `exact`");
    const std::string page = head + offset.lines();
    if (!write.empty() && !(std::ofstream(write) << page)) {
      return {ErrorCode::io, "cannot write " + write};
    }
    std::ifstream file(check);
    const std::string kept((std::istreambuf_iterator<char>(file)), {});
    if (!check.empty() && without_embree(kept) != without_embree(page)) {
      std::printf("%s is out of date\n", check.c_str());
      return false;
    }
    return offset.passed();
  });
}

}  // namespace
}  // namespace raymill::extremes

int main(int argc, char** argv) { return raymill::extremes::main(argc, argv); }
