// A store's pages in memory, and kernels run on them without an engine, under any schedule of residency.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/pages/page_image.h"
#include "tests/support/trees.h"
#include "traversal/kernel.h"

namespace raymill::tests {

struct LoadedPages {
  std::vector<storage::PageBuffer> images;
  storage::PageRules rules;
  std::uint32_t root_page = 0;
  std::uint16_t root_node = 0;
};
LoadedPages load_pages(const std::string& store_path);
LoadedPages load_pages(const Pages& pages);

enum class Residency : std::uint8_t {
  all,       ///< every page is there
  one_page,  ///< only the page that the ray waits for: it suspends at every page border
  random,    ///< half of the pages, another half each time
};

struct KernelRun {
  traversal::Isa isa = traversal::runnable_isas().back();
  Query query = Query::closest;
  Mode mode = Mode::watertight;
  Residency residency = Residency::all;
  std::uint64_t seed = 1;
  std::size_t batch_rays = 1;  ///< rays that the kernel is given at once
  traversal::Footprint footprint = {};
};
struct KernelHits {
  std::vector<Hit> hits;                       ///< of crossings, their count
  std::vector<traversal::Crossing> crossings;  ///< of Query::all, in the order in which they were found
  traversal::KernelCounters counters;
  bool corrupt = false;
};

/// Traces the rays batch by batch; between two calls of the kernel a ray is packed to a record and unpacked again. Of a
/// batch's rays those run together that wait for the page of the first that is not done.
KernelHits run_kernel(const LoadedPages& pages, std::span<const Ray> rays, const KernelRun& run);

}  // namespace raymill::tests
