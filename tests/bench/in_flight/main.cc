// raymill-in-flight: bytes of memory for each ray that waits for a page, by the growth of the process.
//
//   raymill-in-flight STORE RAYS.npy [--query any] [--there 10] [--count 10M]
//
// Rays run by the kernels on a store of which a random part of the pages is there, and wait where the first page is
// missing, in the product's own container and records. Growth counts all of it: records, chunks that are not full,
// queues and tables. One line of JSON. Exit codes: 0; 2 it could not be run.
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>

#include "client/cli/parse.h"
#include "client/cli/random.h"
#include "client/cli/ray_file.h"
#include "storage/base/ledger.h"
#include "tests/bench/in_core/resident_store.h"
#include "tests/support/tool.h"
#include "traversal/waiting_rays.h"

namespace raymill::bench {
namespace {

using storage::PageId;
using traversal::RayState;
using traversal::WaitingRays;

struct Options {
  std::string store, rays;
  std::string query = "closest";
  double there_percent = 10;
  std::string count = "10M";
  std::uint64_t seed = 1;
};

// The store's images with a random part of them hidden.
class SomePages {
 public:
  SomePages(const ResidentStore& store, double there_percent, std::uint64_t seed)
      : images_(store.page_count()), touched_(store.page_count()) {
    client::Random random(seed);
    for (std::uint32_t page = 0; page < store.page_count(); ++page) {
      const bool is_there = page == store.root_page() || random.unit() * 100 < there_percent;
      images_[page] = is_there ? store.image(page) : nullptr;
    }
    object_level_ = store.object_level();
  }
  [[nodiscard]] traversal::KernelContext context() {
    traversal::KernelContext context;
    context.images = images_.data();
    context.touched = touched_.data();
    context.object_level = object_level_;
    return context;
  }

 private:
  std::vector<std::atomic<const std::byte*>> images_;
  std::vector<std::atomic<std::uint8_t>> touched_;
  unsigned object_level_ = 0;
};

struct Parked {
  std::uint64_t rays = 0;
  std::uint64_t record_bytes = 0;
  std::uint64_t done = 0;
};

Status park(WaitingRays& waiting, std::span<const RayState> batch, Parked& parked) {
  const traversal::RecordLayout& layout = waiting.pool().layout();
  for (const RayState& ray : batch) {
    if (ray.done) {
      ++parked.done;
      continue;
    }
    const std::size_t bytes = layout.bytes(ray);
    std::byte* record = waiting.append(PageId{ray.page}, bytes);
    if (record == nullptr) {
      return {ErrorCode::internal, "the pool is full"};
    }
    layout.pack(ray, record);
    ++parked.rays;
    parked.record_bytes += bytes;
  }
  return {};
}

Result<nlohmann::json> run(const Options& options) {
  RAYMILL_ASSIGN_OR_RETURN(const auto store, ResidentStore::load(options.store));
  RAYMILL_ASSIGN_OR_RETURN(const Query query, parse_query(options.query));
  RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t most, client::parse_count(options.count));
  RAYMILL_ASSIGN_OR_RETURN(auto reader, client::RayFileReader::open(options.rays));
  constexpr std::size_t kBatch = 512;
  std::vector<Ray> rays(kBatch);
  std::vector<RayState> batch;
  SomePages pages(store, options.there_percent, options.seed);
  traversal::KernelContext context = pages.context();
  const traversal::Kernel kernel = store.kernel({.isa = traversal::runnable_isas().front(), .query = query});

  storage::Ledger ledger(std::numeric_limits<std::uint64_t>::max());
  // As a job asks: with instances, for closest hits, their ids too.
  const Field closest = store.object_level() != 0 ? kDefaultClosestFields | Field::instance_id : kDefaultClosestFields;
  const Field kept = query == Query::any ? Field::t : closest;
  WaitingRays::Config config;
  config.layout =
      traversal::RecordLayout(kept, traversal::KeptCorners::none, {.instance_id = has(kept, Field::instance_id)});
  config.page_count = store.page_count();
  config.group_pages = std::max(1U, store.page_count() / 16);
  config.pool_chunks = static_cast<std::uint32_t>(traversal::RayPool::chunks_for(
      most * config.layout.most_bytes(), store.page_count(), config.layout.most_bytes()));
  config.extent_bytes = std::size_t{1} << 20;
  config.most_extents = 1;
  Parked parked;
  const std::uint64_t before = storage::resident_bytes();
  RAYMILL_ASSIGN_OR_RETURN(const auto waiting, WaitingRays::create(config, ledger));
  while (parked.rays < most) {
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read(rays));
    if (count == 0) {
      break;
    }
    store.begin(std::span(rays).first(std::min<std::uint64_t>(count, most - parked.rays)), batch);
    kernel(context, batch);
    RAYMILL_RETURN_IF_ERROR(park(*waiting, batch, parked));
  }
  const std::uint64_t grown = storage::resident_bytes() - before;
  if (parked.rays == 0) {
    return {ErrorCode::invalid_argument, "no ray waits; give more rays, or a lower --there"};
  }
  const double bytes = static_cast<double>(grown) / static_cast<double>(parked.rays);
  return nlohmann::json{
      {"query", options.query},
      {"pages_there_percent", options.there_percent},
      {"rays_waiting", parked.rays},
      {"rays_done", parked.done},
      {"rss_growth_bytes", grown},
      {"bytes_per_ray", bytes},
      {"record_bytes_per_ray", static_cast<double>(parked.record_bytes) / static_cast<double>(parked.rays)},
      {"rays_in_128_MiB", static_cast<std::uint64_t>(double(mebibytes(128)) / bytes)}};
}

int main(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-in-flight", "Memory for each ray that waits for a page.");
  tool.option("STORE", options.store, "The store").required();
  tool.option("RAYS", options.rays, "Ray file").required();
  tool.option("--query", options.query, "closest or any");
  tool.option("--there", options.there_percent, "Percent of the pages that are there").between(0, 100);
  tool.option("--count", options.count, "Rays that are to wait");
  tool.option("--seed", options.seed, "Of the choice of pages");
  return tool.run(argc, argv, [&]() -> Result<bool> {
    RAYMILL_ASSIGN_OR_RETURN(const nlohmann::json line, run(options));
    std::cout << line.dump() << std::endl;
    return true;
  });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
