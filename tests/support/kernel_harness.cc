#include "tests/support/kernel_harness.h"

#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <memory>

#include "storage/io/store_file.h"
#include "storage/pages/codec.h"
#include "traversal/ray_state.h"
#include "traversal/trace_job.h"

namespace raymill::tests {

using namespace storage;
using namespace traversal;

LoadedPages load_pages(const std::string& store_path) {
  Ledger ledger(gibibytes(8));
  auto opened = StoreFile::open(store_path, ledger);
  EXPECT_TRUE(opened.ok()) << opened.status().message();
  const StoreFile& file = **opened;
  LoadedPages pages{{}, file.rules(), file.footer().root_page, static_cast<std::uint16_t>(file.footer().root_node)};
  std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>> buffer(file.read_buffer_bytes());
  PageDecoder decoder(file.rules(), file.positions(), file.codec());
  for (std::uint32_t i = 0; i < file.page_count(); ++i) {
    const auto encoded = file.read_page(PageId{i}, buffer);
    PageBuffer frame(file.header().page_bytes);
    const auto size = decoder.decode(*encoded, frame);
    EXPECT_TRUE(size.ok()) << size.status().message();
    frame.resize(*size);
    pages.images.push_back(std::move(frame));
  }
  return pages;
}

LoadedPages load_pages(const Pages& pages) { return {pages.images, pages.rules, pages.plan.page_of[0], 0}; }

KernelHits run_kernel(const LoadedPages& pages, std::span<const Ray> rays, const KernelRun& run) {
  const std::size_t page_count = pages.images.size();
  const auto images = std::make_unique<std::atomic<const std::byte*>[]>(page_count);
  const auto touched = std::make_unique<std::atomic<std::uint8_t>[]>(page_count);
  const unsigned bits = pages.rules.width * pages.rules.levels;
  const Kernel kernel = find_kernel(run.isa, {run.query, run.mode, pages.rules.width, run.wide_stack || bits > 64});
  const RecordLayout records(Field::all);
  std::vector<std::byte> record(records.most_bytes());
  Random random(run.seed);

  KernelHits result;
  for (const Ray& ray : rays) {
    Hit miss;
    if (!TraceJob::valid(ray)) {
      miss.t = std::numeric_limits<float>::quiet_NaN();
      result.hits.push_back(miss);
      continue;
    }
    RayState state;
    state.org = ray.org;
    state.dir = ray.dir;
    state.tnear = ray.tnear;
    state.tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
    state.page = pages.root_page;
    state.node = pages.root_node;
    while (!state.done) {
      for (std::size_t page = 0; page < page_count; ++page) {
        const bool there = page == state.page || run.residency == Residency::all ||
                           (run.residency == Residency::random && random.below(2) == 0);
        images[page].store(there ? pages.images[page].data() : nullptr);
      }
      KernelContext context{images.get(), touched.get(), true, {}, false};
      kernel(context, {&state, 1});
      result.corrupt = result.corrupt || context.corrupt;
      if (!state.done) {
        const std::uint32_t page = state.page;
        records.pack(state, record.data());
        records.unpack(record.data(), state);
        state.page = page;
      }
    }
    result.hits.push_back(state.hit);
  }
  return result;
}

}  // namespace raymill::tests
