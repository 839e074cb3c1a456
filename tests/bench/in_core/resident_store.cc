#include "tests/bench/in_core/resident_store.h"

#include <algorithm>
#include <limits>

#include "storage/base/aligned.h"
#include "storage/pages/codec.h"

namespace raymill::bench {

using storage::PageId;
using traversal::RayState;

Result<ResidentStore> ResidentStore::load(const std::string& path) {
  ResidentStore store;
  store.ledger_ = std::make_unique<storage::Ledger>(std::numeric_limits<std::uint64_t>::max());
  RAYMILL_ASSIGN_OR_RETURN(store.file_, storage::StoreFile::open(path, *store.ledger_));
  const storage::StoreFile& file = *store.file_;
  const storage::PageCache::Config config{file.page_count(), file.header().page_bytes, file.page_count(), 1};
  RAYMILL_ASSIGN_OR_RETURN(store.cache_, storage::PageCache::create(config, *store.ledger_));
  std::vector<std::byte, storage::AlignedAllocator<std::byte, storage::kDirectBlockBytes>> buffer(
      file.read_buffer_bytes());
  storage::PageDecoder decoder(file.rules(), file.positions(), file.codec());
  const std::vector<std::uint32_t> demand(file.page_count());
  std::unique_ptr<traversal::TreeExpander> expander;
  if (traversal::ExpandedTree::possible(file)) {
    RAYMILL_ASSIGN_OR_RETURN(expander, traversal::TreeExpander::create(file, *store.ledger_));
  }
  for (std::uint32_t page = 0; page < file.page_count(); ++page) {
    const auto lease = store.cache_->begin_read(PageId{page}, {demand, {}});
    RAYMILL_ASSIGN_OR_RETURN(const auto encoded, file.read_page(PageId{page}, buffer));
    RAYMILL_ASSIGN_OR_RETURN([[maybe_unused]] const auto bytes, decoder.decode(encoded, lease->bytes));
    if (expander) {
      RAYMILL_RETURN_IF_ERROR(expander->add(PageId{page}, lease->bytes.data()));
    }
    store.cache_->publish(*lease);
  }
  if (expander) {
    RAYMILL_ASSIGN_OR_RETURN(store.expanded_, expander->finish());
  }
  return store;
}

traversal::Kernel ResidentStore::kernel(const Run& run) const {
  const storage::PageRules rules = file_->rules();
  return find_kernel(run.isa, {run.query, run.mode, rules.width});
}

void ResidentStore::begin(std::span<const Ray> rays, std::vector<RayState>& states) const {
  states.assign(rays.size(), {});
  for (std::size_t i = 0; i < rays.size(); ++i) {
    RayState& state = states[i];
    state.org = rays[i].org;
    state.dir = rays[i].dir;
    state.tnear = rays[i].tnear;
    state.tfar = std::min(rays[i].tfar, std::numeric_limits<float>::max());
    state.page = file_->footer().root_page;
    state.node = static_cast<std::uint16_t>(file_->footer().root_node);
  }
}

Result<traversal::KernelCounters> ResidentStore::trace(const Run& run, std::span<const Ray> rays,
                                                       std::span<Hit> hits) const {
  const traversal::Kernel traces = kernel(run);
  traversal::KernelContext context;
  context.images = cache_->images();
  context.touched = cache_->touched();
  context.object_level = object_level();
  // Batch by batch, as the engine does.
  std::vector<RayState> batch;
  for (std::size_t first = 0; first < rays.size(); first += run.batch_rays) {
    const std::size_t count = std::min(run.batch_rays, rays.size() - first);
    begin(rays.subspan(first, count), batch);
    traces(context, batch);
    for (std::size_t i = 0; i < count; ++i) {
      hits[first + i] = batch[i].has_hit ? batch[i].hit : Hit{};
    }
  }
  if (context.corrupt) {
    return {ErrorCode::corrupt, file_->path() + ": has pages whose references do not fit each other"};
  }
  return context.counters;
}

Result<traversal::KernelCounters> ResidentStore::trace_expanded(const Run& run, std::span<const Ray> rays,
                                                                std::span<Hit> hits) const {
  const auto traces = find_expanded_kernel(run.isa, {run.query, run.mode, width()});
  traversal::ExpandedContext context;
  context.tree = expanded_->view();
  std::fill(hits.begin(), hits.end(), Hit{});
  for (std::size_t first = 0; first < rays.size(); first += run.batch_rays) {
    const std::size_t count = std::min(run.batch_rays, rays.size() - first);
    traces(context, rays.subspan(first, count), hits.subspan(first, count));
  }
  return context.counters;
}

}  // namespace raymill::bench
