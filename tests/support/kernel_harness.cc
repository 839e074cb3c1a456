#include "tests/support/kernel_harness.h"

#include <gtest/gtest.h>

#include <algorithm>
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

namespace {

// What stands in the record of a ray that waits.
RecordLayout records_for(const KernelRun& run) {
  const KeptExtras extras{.instance_id = true, .normals = true, .texel = true};
  if (run.query == Query::count || run.query == Query::all) {
    return RecordLayout(Field::count, KeptCorners::none, extras);
  }
  const bool ties_need_corners = run.mode == Mode::exact && run.query == Query::closest;
  return RecordLayout(Field::all, ties_need_corners ? KeptCorners::of_hit : KeptCorners::none, extras);
}

}  // namespace

KernelHits run_kernel(const LoadedPages& pages, std::span<const Ray> rays, const KernelRun& run) {
  const std::size_t page_count = pages.images.size();
  const auto images = std::make_unique<std::atomic<const std::byte*>[]>(page_count);
  const auto touched = std::make_unique<std::atomic<std::uint8_t>[]>(page_count);
  const Kernel kernel = find_kernel(run.isa, {run.query, run.mode, pages.rules.width});
  const RecordLayout records = records_for(run);
  std::vector<std::byte> record(records.most_bytes());
  Random random(run.seed);

  KernelHits result;
  result.hits.resize(rays.size());
  std::vector<Crossing> room(7);
  CrossingBuffer crossings{.room = room,
                           .take =
                               [](void* owner, std::span<const Crossing> some) {
                                 auto& all = *static_cast<std::vector<Crossing>*>(owner);
                                 all.insert(all.end(), some.begin(), some.end());
                               },
                           .owner = &result.crossings};
  std::vector<RayState> waiting, together;
  for (std::size_t begin = 0; begin < rays.size(); begin += run.batch_rays) {
    waiting.clear();
    for (std::size_t i = begin; i < std::min(begin + run.batch_rays, rays.size()); ++i) {
      if (!TraceJob::valid(rays[i])) {
        result.hits[i].t = std::numeric_limits<float>::quiet_NaN();
        continue;
      }
      RayState& state = waiting.emplace_back();
      state.org = rays[i].org;
      state.dir = rays[i].dir;
      state.tnear = rays[i].tnear;
      state.tfar = std::min(rays[i].tfar, std::numeric_limits<float>::max());
      state.number = static_cast<std::uint32_t>(i);
      state.page = pages.root_page;
      state.node = pages.root_node;
    }
    while (!waiting.empty()) {
      const std::uint32_t here = waiting.front().page;
      const auto others = std::stable_partition(waiting.begin(), waiting.end(),
                                                [here](const RayState& state) { return state.page == here; });
      together.assign(waiting.begin(), others);
      waiting.erase(waiting.begin(), others);
      for (std::size_t page = 0; page < page_count; ++page) {
        const bool there = page == here || run.residency == Residency::all ||
                           (run.residency == Residency::random && random.below(2) == 0);
        images[page].store(there ? pages.images[page].data() : nullptr);
      }
      KernelContext context{images.get(), touched.get(), true, {}, false};
      context.crossings = run.query == Query::all ? &crossings : nullptr;
      context.object_level = pages.rules.object_level;
      context.footprint = run.footprint.length > 0 || run.footprint.angle > 0 ? &run.footprint : nullptr;
      context.masks = pages.rules.masks;
      context.page_bytes = pages.rules.page_bytes;
      kernel(context, together);
      result.corrupt = result.corrupt || context.corrupt;
      result.counters.nodes_visited += context.counters.nodes_visited;
      result.counters.triangles_tested += context.counters.triangles_tested;
      result.counters.proxies_taken += context.counters.proxies_taken;
      result.counters.texels_read += context.counters.texels_read;
      for (RayState& state : together) {
        if (state.done) {
          result.hits[state.number] = state.hit;
          continue;
        }
        const std::uint32_t page = state.page;
        records.pack(state, record.data());
        records.unpack(record.data(), state);
        state.page = page;
        waiting.push_back(state);
      }
    }
  }
  crossings.empty();
  return result;
}

}  // namespace raymill::tests
