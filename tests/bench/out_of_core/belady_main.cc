// raymill-belady: how few reads a run's page requests could have done with.
//
//   raymill trace X.mill RAYS.npy -o HITS.npy --memory M --page-trace RUN.pages
//   raymill-belady RUN.pages [--frames N]
//
// The bound is for the same requests in the same order: another victim would have let other rays go on, so other
// requests would have followed. It says how much a better choice of victims could save, not how much a better order of
// work could. Needs 8 to 12 bytes a request of memory.
#include <cstdio>
#include <nlohmann/json.hpp>

#include "tests/bench/out_of_core/belady.h"
#include "tests/support/tool.h"

int main(int argc, char** argv) {
  using namespace raymill;
  tests::Tool tool("raymill-belady", "Reads of a page trace, and of Belady's optimum for the same requests, as JSON.");
  std::string path;
  std::uint32_t frames = 0;
  tool.option("TRACE", path, "As raymill trace --page-trace wrote it").required();
  tool.option("--frames", frames, "Pages that memory holds; left out: as many as in the run");
  return tool.run(argc, argv, [&]() -> Result<bool> {
    RAYMILL_ASSIGN_OR_RETURN(const auto trace, bench::read_page_trace(path));
    frames = frames > 0 ? frames : trace.frame_count;
    const nlohmann::json told = {{"frames", frames},
                                 {"batches", trace.batches},
                                 {"requests", trace.pages.size()},
                                 {"distinct_pages", bench::distinct_pages(trace.pages, trace.page_count)},
                                 {"reads", trace.reads},
                                 {"evictions", trace.evictions},
                                 {"belady_reads", bench::belady_reads(trace.pages, trace.page_count, frames)}};
    std::printf("%s\n", told.dump().c_str());
    return true;
  });
}
