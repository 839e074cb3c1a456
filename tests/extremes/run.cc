#include "tests/extremes/run.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <numeric>

#include "client/cli/bench/embree_scene.h"
#include "tests/support/brute_force.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/mesh_files.h"
#include "tests/support/stores.h"
#include "traversal/engine.h"

namespace raymill::extremes {
namespace {

constexpr std::array<Mode, 3> kModes = {Mode::fast, Mode::watertight, Mode::exact};
constexpr std::uint64_t kTruthTests = 400'000;  // of a ray and a triangle, for each row
constexpr std::size_t kSlowRays = 100;          // that are suspended at every node
constexpr std::size_t kManyPages = 60;          // twice what the least memory holds

std::vector<Triangle> decoded_triangles(const tests::LoadedPages& pages) {
  std::vector<Triangle> triangles;
  for (const storage::PageBuffer& image : pages.images) {
    const storage::PageView view(image.data());
    for (std::uint32_t i = 0; i < view.header().triangle_count; ++i) {
      Triangle& triangle = triangles.emplace_back();
      for (std::uint32_t k = 0; k < 3; ++k) {
        triangle.v[k] = view.vertices()[view.indices()[3 * i + k]];
      }
      triangle.geometry_id = view.geometry_id(i);
      triangle.primitive_id = view.primitive_ids()[i];
    }
  }
  std::sort(triangles.begin(), triangles.end(), [](const Triangle& a, const Triangle& b) {
    return a.geometry_id != b.geometry_id ? a.geometry_id < b.geometry_id : a.primitive_id < b.primitive_id;
  });
  return triangles;
}

bool is_finite(const std::array<float, 3>& v) {
  return std::all_of(v.begin(), v.end(), [](float x) { return std::isfinite(x); });
}
bool is_valid_ray(const Ray& ray) {
  return is_finite(ray.org) && is_finite(ray.dir) && ray.dir != std::array<float, 3>{} && ray.tnear <= ray.tfar;
}

// By float64; of equal t the least ids.
Hit true_hit(std::span<const Triangle> triangles, const Ray& ray) {
  Hit best;
  if (!is_valid_ray(ray)) {
    best.t = std::numeric_limits<float>::quiet_NaN();
    return best;
  }
  for (const tests::OracleHit& hit : tests::oracle_hits(triangles, ray)) {
    if (hit.t < ray.tnear || hit.t > ray.tfar) {
      continue;  // within the oracle's doubt, and outside all the same
    }
    const auto t = static_cast<float>(hit.t);
    const bool is_first = best.primitive_id == kNoId;
    const bool has_less = hit.triangle->geometry_id != best.geometry_id
                              ? hit.triangle->geometry_id < best.geometry_id
                              : hit.triangle->primitive_id < best.primitive_id;
    if (is_first || (t == best.t && has_less)) {
      best = {t, static_cast<float>(hit.u), static_cast<float>(hit.v), hit.triangle->primitive_id,
              hit.triangle->geometry_id};
    }
  }
  return best;
}

class Run {
 public:
  Run(const Row& row, const std::string& openvdb) : row_(row), config_(row.config) {
    config_.output = folder_ / "row.mill";
    if (row.volume) {
      if (build_volume()) {
        triangles_ = tests::triangles_of(row.scene);
        rays_ = row.rays(triangles_);
        ours();
        ask_openvdb(openvdb);
      }
      return;
    }
    if (row.placed) {
      (void)tests::build_placed(folder_, "row.mill", *row.placed, config_);
      triangles_ = tests::triangles_of(tests::flattened(*row.placed));
      rays_ = row.rays(triangles_);
      ours();
      embree();
      return;
    }
    const auto report = tests::build_in_runs(row.scene, config_, std::numeric_limits<std::uint32_t>::max());
    if (!report) {
      problem("is not built: " + report.status().message());
      return;
    }
    pages_ = tests::load_pages(config_.output);
    page_count_ = pages_.images.size();
    triangles_ = decoded_triangles(pages_);
    rays_ = row.rays(triangles_);
    ours();
    embree();
  }
  [[nodiscard]] Told take() { return std::move(told_); }

 private:
  // Triangles of one space: those that the kernels of tests and the float64 of triangles know.
  [[nodiscard]] bool is_plain() const { return !row_.placed && !row_.volume; }

  bool build_volume() {
    config_.scenes = {tests::write_volume_file(folder_, "row.vdb", *row_.volume)};
    if (!row_.scene.empty()) {
      tests::write_file(folder_ / "row.obj", tests::obj(row_.scene, false));
      config_.scenes.insert(config_.scenes.begin(), folder_ / "row.obj");
    }
    const auto report = build(config_);
    if (!report) {
      problem("is not built: " + report.status().message());
      return false;
    }
    page_count_ = report->pages;
    return true;
  }

  void problem(const std::string& what) { told_.problems.push_back(row_.id + " " + what); }

  [[nodiscard]] std::string tell(std::span<const Hit> hits) const {
    return row_.tell({triangles_, std::span(rays_).first(hits.size()), hits, truth_});
  }

  void ours() {
    const std::size_t truths = std::min<std::size_t>(
        rays_.size(), row_.volume ? rays_.size() : std::max<std::size_t>(8, kTruthTests / triangles_.size()));
    for (const Ray& ray : std::span(rays_).first(truths)) {
      truth_.push_back(truth_of(ray));
    }
    told_.truth = tell(truth_);
    tests::TraceSetup least;
    least.engine.threads = 2;
    tests::set_least_memory(config_.output, least.engine);
    for (std::size_t i = 0; i < kModes.size(); ++i) {
      const std::vector<Hit> hits = in_core(kModes[i]);
      told_.modes[i] = tell(hits);
      if (!row_.keeps(kModes[i], {triangles_, rays_, hits, truth_})) {
        problem("in mode " + std::string(to_string(kModes[i])) + ": " + told_.modes[i] + "; promised: " + row_.promise);
      }
      if (kModes[i] != Mode::fast && is_plain()) {
        against_truth(kModes[i], hits);
      }
      paged(kModes[i], hits, least);
    }
  }

  [[nodiscard]] Hit truth_of(const Ray& ray) const {
    return row_.volume && row_.scene.empty() ? volume_truth(*row_.volume, ray)
           : row_.placed                     ? placed_truth(*row_.placed, ray)
                                             : true_hit(triangles_, ray);
  }

  std::vector<Hit> in_core(Mode mode) {
    std::vector<Hit> first;
    for (const std::string& isa : available_isas()) {
      tests::TraceSetup setup;
      setup.engine.isa = isa;
      setup.trace.mode = mode;
      const tests::Traced traced = tests::trace(config_.output, rays_, setup);
      if (first.empty()) {
        first = traced.hits;
      }
      same(first, traced, mode, isa);
    }
    return first;
  }

  void paged(Mode mode, const std::vector<Hit>& hits, tests::TraceSetup& least) {
    least.trace.mode = mode;
    tests::Traced traced = tests::trace(config_.output, rays_, least);
    for (int tries = 0; traced.status.code() == ErrorCode::budget_exceeded && tries < 64; ++tries) {
      least.engine.memory += kibibytes(64);  // the process has grown meanwhile
      traced = tests::trace(config_.output, rays_, least);
    }
    same(hits, traced, mode, "the least memory");
    if (page_count_ >= kManyPages && traced.stats.pages_read <= traced.stats.distinct_pages) {
      problem("has " + std::to_string(page_count_) + " pages, and the least memory holds them all");
    }
    if (is_plain()) {
      const tests::KernelRun one_page{.mode = mode, .residency = tests::Residency::one_page, .batch_rays = 256};
      tests::Traced alone;
      alone.hits = tests::run_kernel(pages_, rays_, one_page).hits;
      same(hits, alone, mode, "one page there at a time");
    }
    tests::TraceSetup slow;
    slow.engine.adversarial = true;
    slow.trace.mode = mode;
    const std::size_t few = std::min(rays_.size(), kSlowRays);
    same(std::span(hits).first(few), tests::trace(config_.output, std::span(rays_).first(few), slow), mode,
         "rays suspended at every node");
  }

  void same(std::span<const Hit> expected, const tests::Traced& traced, Mode mode, const std::string& way) {
    const std::string where = "in mode " + std::string(to_string(mode)) + " with " + way + ": ";
    if (!traced.status.ok()) {
      problem(where + traced.status.message());
      return;
    }
    bool equal = expected.size() == traced.hits.size();
    for (std::size_t i = 0; equal && i < expected.size(); ++i) {
      equal = tests::same_bits(expected[i], traced.hits[i]);
    }
    if (!equal) {
      problem(where + "other bits");
    }
  }

  // Where float64 is certain: hit or miss in both modes, and t to its rounding in exact.
  void against_truth(Mode mode, const std::vector<Hit>& hits) {
    const double t_ulps = mode == Mode::exact ? 0.51 : std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < truth_.size(); ++i) {
      const std::string objection =
          is_valid_ray(rays_[i]) ? tests::oracle_objects(triangles_, rays_[i], hits[i], t_ulps) : std::string();
      if (!objection.empty()) {
        problem("in mode " + std::string(to_string(mode)) + ", " + tests::text_of(rays_[i]) + ": " + objection);
        return;
      }
    }
  }

  // By the program beside the tests of volumes, which alone loads it.
  void ask_openvdb(const std::string& program) {
    if (program.empty() || !row_.not_for_embree.empty()) {
      told_.embree.fill(program.empty() ? "not asked" : row_.not_for_embree);
      return;
    }
    const std::string vdb = folder_ / "openvdb.vdb", rays = folder_ / "rays.f32", out = folder_ / "out.f32";
    std::ofstream(rays, std::ios::binary)
        .write(reinterpret_cast<const char*>(rays_.data()), static_cast<std::streamsize>(rays_.size() * sizeof(Ray)));
    const std::string make = "'" + program + "' make ball '" + vdb + "'";
    const std::string surface = "'" + program + "' surface '" + vdb + "' '" + rays + "' '" + out + "'";
    std::vector<std::array<float, 4>> answers(rays_.size());
    const bool ran = std::system(make.c_str()) == 0 && std::system(surface.c_str()) == 0;
    std::ifstream file(out, std::ios::binary);
    file.read(reinterpret_cast<char*>(answers.data()), static_cast<std::streamsize>(rays_.size() * 16));
    if (!ran || !file) {
      problem("in OpenVDB: " + program + " failed");
      return;
    }
    std::vector<Hit> hits;
    for (const auto& answer : answers) {
      hits.push_back({.t = answer[0]});
    }
    told_.embree = {"has no volumes", "OpenVDB: " + tell(hits)};
  }

  Result<client::EmbreeScene> embree_scene(bool is_robust) {
    if (!row_.placed) {
      return client::EmbreeScene::create({.robust = is_robust},
                                         [this](storage::TriangleSink& sink) { return sink.add(triangles_); });
    }
    RAYMILL_ASSIGN_OR_RETURN(const client::PlacedTriangles placed, client::read_placed_triangles(config_.output));
    return client::EmbreeScene::create({.robust = is_robust}, placed);
  }

  void embree() {
    if (!row_.not_for_embree.empty()) {
      told_.embree = {row_.not_for_embree, row_.not_for_embree};
      return;
    }
    for (const bool is_robust : {false, true}) {
      const auto scene = embree_scene(is_robust);
      if (!scene) {
        problem("in Embree: " + scene.status().message());
        return;
      }
      std::vector<Hit> hits;
      for (const Ray& ray : rays_) {
        Hit& hit = hits.emplace_back(scene->closest_hit(ray));
        if (hit.primitive_id != kNoId && !row_.placed) {
          const Triangle& triangle = triangles_[hit.primitive_id];
          hit.geometry_id = triangle.geometry_id;
          hit.primitive_id = triangle.primitive_id;
        }
      }
      told_.embree[is_robust ? 1 : 0] = tell(hits);
    }
  }

  const Row& row_;
  const tests::TempFolder folder_;
  BuildConfig config_;
  tests::LoadedPages pages_;
  std::uint64_t page_count_ = 0;
  std::vector<Triangle> triangles_;
  std::vector<Ray> rays_;
  std::vector<Hit> truth_;
  Told told_;
};

}  // namespace

Told run(const Row& row, const std::string& openvdb) { return Run(row, openvdb).take(); }

}  // namespace raymill::extremes
