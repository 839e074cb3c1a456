// raymill-seed: the algorithms of "Stackless Multi-BVH Traversal for CPU, MIC and GPU Ray Tracing" (Afra &
// Szirmay-Kalos 2014) beside each other, in core.
//
//   raymill-seed STORE RAYS.npy... [--repeat 5] [--most-rays 100000]
//
// One thread, one ray at a time, closest hit. The store's triangles are put into one binary SAH tree, and that into the
// layouts of trees.h. A repetition runs every algorithm once, one after the other, by the thread's CPU time; medians
// are printed. Nodes and triangles are counted in a run of its own. All algorithms must give the same hits bit for bit,
// and for a few rays those of a loop over all triangles. Tables for each file of rays, and a line of JSON. Exit codes:
// 0; 1 hits differ; 2 it could not be run.
#include <algorithm>
#include <bit>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>

#include "client/cli/bench/store_triangles.h"
#include "tests/bench/seed/report.h"
#include "tests/bench/tool.h"
#include "tests/support/tool.h"

namespace raymill::bench {
namespace {

// A loop over all triangles takes milliseconds a ray.
constexpr std::size_t kBruteForceRays = 50;

struct Options {
  std::string store;
  std::vector<std::string> rays;
  unsigned repeat = 5;
  std::size_t most_rays = std::numeric_limits<std::size_t>::max();
};

Result<Trees> load(const std::string& store) {
  TriangleCollector collector;
  RAYMILL_RETURN_IF_ERROR(client::read_store_triangles(store, collector));
  return build_trees(std::move(collector.all));
}

bool same_bits(const SeedHit& a, const SeedHit& b) {
  return std::bit_cast<std::uint32_t>(a.t) == std::bit_cast<std::uint32_t>(b.t) &&
         std::bit_cast<std::uint32_t>(a.u) == std::bit_cast<std::uint32_t>(b.u) &&
         std::bit_cast<std::uint32_t>(a.v) == std::bit_cast<std::uint32_t>(b.v) && a.triangle == b.triangle;
}

// Hits that are not those of `expected`, as far as that goes.
std::size_t count_different(std::span<const SeedHit> expected, std::span<const SeedHit> hits) {
  std::size_t different = 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    different += same_bits(expected[i], hits[i]) ? 0 : 1;
  }
  return different;
}

// The counting runs come first and warm the caches up.
void count_visits(const Trees& trees, std::span<const Ray> rays, std::span<const SeedHit> by_brute_force, Run& run,
                  std::vector<SeedHit>& expected) {
  std::vector<SeedHit> hits(rays.size());
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    Measured& its = run.measured[i];
    its.counters = run.algorithms[i].count(trees, rays, hits);
    if (i == 0) {
      expected = hits;
    }
    its.different += count_different(by_brute_force, hits) + count_different(expected, hits);
  }
}

void measure_speeds(const Trees& trees, std::span<const Ray> rays, unsigned repeat, std::span<const SeedHit> expected,
                    Run& run) {
  std::vector<SeedHit> hits(rays.size());
  for (unsigned repetition = 0; repetition < repeat; ++repetition) {
    double stack_seconds = 0;
    for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
      const double begin = thread_seconds();
      run.algorithms[i].trace(trees, rays, hits);
      const double seconds = thread_seconds() - begin;
      stack_seconds = run.algorithms[i].name == kStackName ? seconds : stack_seconds;
      run.measured[i].rates.push_back(static_cast<double>(rays.size()) / 1e6 / seconds);
      run.measured[i].overheads.push_back(100 * (seconds / stack_seconds - 1));
      run.measured[i].different += count_different(expected, hits);
    }
  }
}

Status run_file(const Options& options, const Trees& trees, const std::string& file, bool& all_alike) {
  RAYMILL_ASSIGN_OR_RETURN(const auto rays, read_rays(file, options.most_rays));
  Run run;
  run.store = std::filesystem::path(options.store).stem().string();
  run.rays_file = std::filesystem::path(file).stem().string();
  run.rays = rays.size();
  run.triangles = trees.triangles.size();
  run.algorithms = algorithms();
  run.measured.resize(run.algorithms.size());

  std::vector<SeedHit> by_brute_force(std::min(kBruteForceRays, rays.size()));
  brute_force().trace(trees, std::span(rays).first(by_brute_force.size()), by_brute_force);
  std::vector<SeedHit> expected;
  count_visits(trees, rays, by_brute_force, run, expected);
  measure_speeds(trees, rays, options.repeat, expected, run);
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    RAYMILL_ASSIGN_OR_RETURN(run.measured[i].resident, measure_resident_rays(run.algorithms[i]));
  }

  print_tables(run);
  std::cout << line_of(run).dump() << std::endl;
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    if (run.measured[i].different > 0) {
      std::fprintf(stderr, "raymill-seed: %s, N = %u: %zu hits differ\n", run.algorithms[i].name.c_str(),
                   run.algorithms[i].width, run.measured[i].different);
      all_alike = false;
    }
  }
  return {};
}

Result<bool> run(const Options& options) {
  bool all_alike = true;
  RAYMILL_ASSIGN_OR_RETURN(const Trees trees, load(options.store));
  for (const std::string& file : options.rays) {
    RAYMILL_RETURN_IF_ERROR(run_file(options, trees, file, all_alike));
  }
  return all_alike;
}

int main(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-seed", "Algorithms of traversal beside each other, one ray at a time.");
  tool.option("STORE", options.store, "The store that the triangles are taken from").required();
  tool.option("RAYS", options.rays, "Ray files").required();
  tool.option("--repeat", options.repeat, "Repetitions").between(1, 1000);
  tool.option("--most-rays", options.most_rays, "Rays of a file that are traced; left out: all");
  return tool.run(argc, argv, [&] { return run(options); });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
