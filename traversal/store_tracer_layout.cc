// StoreTracer, its layouts: which one the budget allows, the way from one to the other, and a batch's kernels.
#include <algorithm>
#include <chrono>
#include <utility>

#include "traversal/store_tracer.h"
#include "traversal/store_tracer_worker.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {
namespace {

// For each job, beside two layouts of the store: fewer would make rays wait for memory that a layout took.
constexpr std::uint64_t kPlentyJobBytes = 32 << 20;

// Sorting costs more than it brings where all that rays read stays in the caches.
constexpr std::uint64_t kLeastSortedStore = 64 << 20;

}  // namespace

// Plans what everything gets. Rays are sorted where they do not wait for pages, which bring those of a place together
// anyway.
Status StoreTracer::plan_memory(const StoreShare& share) {
  const std::uint64_t order_bytes = config_.share.max_jobs * RayOrder::bytes(kSortedRays);
  const bool always = config_.sort_rays == SortRays::always;
  const bool may = config_.sort_rays == SortRays::automatic && file_->footer().decoded_bytes >= kLeastSortedStore &&
                   share.bytes >= file_->footer().decoded_bytes;
  if (!always && !may) {
    return plan_layout(share);
  }
  StoreShare rest = share;
  rest.bytes -= std::min(rest.bytes, order_bytes);
  if (const Status status = plan_layout(rest); !status.ok()) {
    return always ? status : plan_layout(share);
  }
  if (!always && !stays_in_memory()) {
    return plan_layout(share);
  }
  RAYMILL_ASSIGN_OR_RETURN(order_claim_, ledger_.claim(storage::Tag::rays, order_bytes));
  return {};
}

// Whether the plan lets all rays go on without pages that come and go.
bool StoreTracer::stays_in_memory() const {
  return config_.layout == Layout::expanded || plan_.frame_count == file_->page_count();
}

std::uint64_t StoreTracer::expansion_bytes(const StoreShare& share) const {
  return StoreExpansion::bytes(*file_, share.threads) + share.threads * kFreshWorkerBytes +
         share.max_jobs * FreshRays::bytes({share.threads, true, true});
}

// Plans the pages' budget, with what the expanded layout needs set aside where there is to be one.
Status StoreTracer::plan_layout(const StoreShare& share) {
  const bool possible = config_.layout != Layout::compact && ExpandedTree::possible(*file_);
  const std::uint64_t bytes = possible ? expansion_bytes(share) : 0;
  StoreShare rest = share;
  rest.bytes -= std::min(rest.bytes, bytes);
  const std::uint64_t least = least_share_bytes(*file_, share.threads, share.max_jobs);
  if (config_.layout == Layout::expanded) {
    if (file_->has_volumes()) {
      return {ErrorCode::unsupported,
              file_->path() + ": has volumes, which the expanded layout does not hold; use --layout auto"};
    }
    if (file_->has_masks()) {
      return {ErrorCode::unsupported, file_->path() +
                                          ": has triangles with masks, which the expanded layout does not hold; use "
                                          "--layout auto"};
    }
    if (!possible) {
      return {ErrorCode::unsupported, file_->path() +
                                          ": has instances, or more triangles than the expanded layout can hold; use "
                                          "--layout auto"};
    }
    if (rest.bytes < least) {
      return {ErrorCode::budget_exceeded, file_->path() + ": the expanded layout needs " +
                                              storage::format_bytes(bytes + least) + " beside the process itself, " +
                                              storage::format_bytes(share.bytes) +
                                              " left; raise --memory or use --layout auto"};
    }
  }
  const bool plannable = possible && rest.bytes >= least;
  if (plannable) {
    RAYMILL_ASSIGN_OR_RETURN(plan_, plan_budget(*file_, rest));
  }
  const bool enough_for_jobs = config_.layout == Layout::expanded || plan_.job_bytes >= kPlentyJobBytes;
  if (!plannable || !stays_in_memory() || !enough_for_jobs) {
    RAYMILL_ASSIGN_OR_RETURN(plan_, plan_budget(*file_, share));
    return {};
  }
  RAYMILL_ASSIGN_OR_RETURN(expansion_, StoreExpansion::create(*file_, share.threads, ledger_));
  RAYMILL_ASSIGN_OR_RETURN(fresh_claim_, ledger_.claim(storage::Tag::decode, share.threads * kFreshWorkerBytes));
  return {};
}

bool StoreTracer::sorts(std::span<const Ray> rays) const {
  return order_claim_.bytes() > 0 && (config_.sort_rays == SortRays::always || RayOrder::is_scattered(rays));
}

bool StoreTracer::can_expand() const {
  return expansion_ && expansion_->has_pages() && !jobs_.empty() &&
         (config_.layout == Layout::expanded || stats_.rays_at_root >= file_->footer().triangle_count);
}

void StoreTracer::expand_page(Worker& worker, WorkLock& lock) {
  const storage::PageId page = expansion_->take();
  storage::PagePin pin = cache_->pin(worker.index);
  const std::byte* image = cache_->find(page);
  lock.unlock();
  const auto begin = Timeline::Clock::now();
  const Status status = expansion_->expand(worker.index, page, worker.decoder, image);
  const double seconds = std::chrono::duration<double>(Timeline::Clock::now() - begin).count();
  pin.release();
  if (config_.timeline) {
    config_.timeline->span(worker.index, "expand", begin, "page", index_of(page));
  }
  lock.lock();
  stats_.expand_seconds += seconds;
  if (expansion_->settle(status)) {
    lock.unlock();
    auto tree = expansion_->finish();
    lock.lock();
    end_expansion(std::move(tree));
  } else if (expansion_->abandoned()) {
    end_expansion(expansion_->status());
  }
}

// Without a tree rays go on through pages, where damage shows when a ray comes to it; unless the tree was asked for.
void StoreTracer::end_expansion(Result<std::unique_ptr<ExpandedTree>> tree) {
  expansion_.reset();
  if (tree) {
    tree_ = std::move(*tree);
  } else if (config_.layout == Layout::expanded) {
    layout_status_ = tree.status();
    const auto jobs = jobs_;  // remove_job changes the list
    for (const auto& job : jobs) {
      job->status = job->status.ok() ? layout_status_ : job->status;
      remove_job(*job);
      job->changed.notify_all();
    }
  }
  work_wake_.notify_all();
}

// Runs worker.rays to their ends, or to pages that are not there.
StoreTracer::BatchCounters StoreTracer::trace_rays(Worker& worker, const TraceJob& job, storage::PageId page,
                                                   const std::byte* image, CrossingBuffer* crossings) {
  std::span<RayState> rays = worker.rays;
  if (job.among_volumes && (image == nullptr || storage::VolumePageView::is_volume_page(image))) {
    return trace_volumes(worker, job, page, crossings);
  }
  KernelContext context;
  context.images = worker.lone_page ? worker.lone_page->show(index_of(page), image) : cache_->images();
  context.touched = worker.page_lane ? worker.page_lane->marks() : cache_->touched();
  context.need_normal = has(job.config.fields, Field::normal);
  context.filter = job.hit_filter();
  context.crossings = crossings;
  context.object_level = file_->rules().object_level;
  context.footprint = job.footprint();
  context.masks = file_->has_masks();
  context.page_bytes = file_->header().page_bytes;
  job.kernel(context, rays);
  if (worker.lone_page) {
    worker.lone_page->settle(rays, image);
  }
  if (worker.page_lane) {
    worker.page_lane->end_batch(index_of(page), cache_->touched());
  }
  BatchCounters counters{context.counters, context.corrupt};
  if (job.among_volumes) {
    for (RayState& ray : rays) {
      if (ray.done && !(job.config.query == Query::any && ray.has_hit)) {
        if (ray.object.inside) {
          leave_object(ray);
        }
        begin_volumes(job.config.query, job.config.volume, volumes_, ray);
      }
    }
    const BatchCounters after = config_.adversarial ? BatchCounters() : trace_volumes(worker, job, page, crossings);
    counters.kernel.nodes_visited += after.kernel.nodes_visited;
    counters.kernel.pages_entered += after.kernel.pages_entered;
    counters.corrupt = counters.corrupt || after.corrupt;
  }
  return counters;
}

// Runs those of the rays that are among volumes.
StoreTracer::BatchCounters StoreTracer::trace_volumes(Worker& worker, const TraceJob& job, storage::PageId page,
                                                      CrossingBuffer* crossings) const {
  VolumeContext context;
  context.volumes = volumes_;
  context.query = job.config.query;
  context.config = job.config.volume;
  context.need_normal = has(job.config.fields, Field::normal);
  context.filter = job.hit_filter();
  context.crossings = crossings;
  context.images = cache_->images();
  context.touched = worker.page_lane ? worker.page_lane->marks() : cache_->touched();
  context.lone_items = config_.adversarial;
  run_volumes(context, worker.rays);
  if (worker.page_lane) {
    worker.page_lane->end_batch(index_of(page), cache_->touched());
  }
  return {context.counters, context.corrupt};
}

}  // namespace raymill::traversal
