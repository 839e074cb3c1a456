// What the kernels do, counted: nodes visited and triangles tested by fixed rays on kept stores. The
// figures repeat exactly, on every instruction set; that they change is no fault, but it is to be meant.
//
//   raymill_golden_tests             compares with counters.txt
//   raymill_golden_tests --rewrite   writes it, and stores that are missing
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

#include "tests/golden/golden.h"
#include "tests/support/kernel_harness.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill::tests {
namespace {

Scene counted_scene() {
  Random random(7);
  return {soup(random, 1500, 0.15F), grid(16, 0.3F), boxes(random, 20)};
}

std::vector<Ray> counted_rays() {
  Random random(8);
  return random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 3000);
}

std::string counted_store(unsigned width) {
  const std::string path = kGolden + "counters_mbvh" + std::to_string(width) + ".mill";
  if (rewrite() && !std::filesystem::exists(path)) {
    const TempFolder folder;
    BuildConfig config = small_pages();
    config.width = width;
    write_file(path, read_file(build_store(folder, "counted.mill", counted_scene(), config)));
  }
  return path;
}

// One line for each kernel.
std::string count(traversal::Isa isa) {
  std::ostringstream text;
  for (const unsigned width : {4u, 8u}) {
    const LoadedPages pages = load_pages(counted_store(width));
    for (const Query query : {Query::closest, Query::any}) {
      for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
        const KernelRun run{.isa = isa, .query = query, .mode = mode, .batch_rays = 512};
        const auto counters = run_kernel(pages, counted_rays(), run).counters;
        text << to_string(query) << " mbvh" << width << " " << to_string(mode) << ": " << counters.nodes_visited
             << " nodes, " << counters.triangles_tested << " triangles\n";
      }
    }
  }
  return text.str();
}

TEST(Counters, AreThoseThatWereKept) {
  const std::string path = kGolden + "counters.txt";
  for (const traversal::Isa isa : traversal::runnable_isas()) {
    const std::string counted = count(isa);
    if (rewrite()) {
      write_file(path, counted);
    }
    EXPECT_EQ(counted, read_file(path)) << to_string(isa) << "; raymill_golden_tests --rewrite keeps what is meant";
  }
}

}  // namespace
}  // namespace raymill::tests
