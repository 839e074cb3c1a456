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

// A ray that begins: the expanded layout knows no other.
bool begins(const RayState& ray, std::uint32_t root_node) {
  return ray.level == 0 && ray.node == root_node && ray.resume == Resume::enter &&
         (ray.stack.words[0] | ray.stack.words[1]) == 0;
}

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
  const bool stays = plan_.frame_count == file_->page_count() || config_.layout == Layout::expanded;
  if (!always && !stays) {
    return plan_layout(share);
  }
  RAYMILL_ASSIGN_OR_RETURN(order_claim_, ledger_.claim(storage::Tag::rays, order_bytes));
  return {};
}

// Plans the pages' budget, with what the expanded layout needs set aside where there is to be one.
Status StoreTracer::plan_layout(const StoreShare& share) {
  const bool possible = config_.layout != Layout::compact && ExpandedTree::possible(*file_);
  const std::uint64_t bytes = possible ? StoreExpansion::bytes(*file_, share.threads) : 0;
  StoreShare rest = share;
  rest.bytes -= std::min(rest.bytes, bytes);
  const std::uint64_t least = least_share_bytes(*file_, share.threads, share.max_jobs);
  if (config_.layout == Layout::expanded) {
    if (!possible) {
      return {ErrorCode::unsupported, file_->path() +
                                          ": has more triangles than the expanded layout can hold; use "
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
  const bool plenty = plannable && plan_.frame_count == file_->page_count() && plan_.job_bytes >= kPlentyJobBytes;
  if (config_.layout != Layout::expanded && !plenty) {
    RAYMILL_ASSIGN_OR_RETURN(plan_, plan_budget(*file_, share));
    return {};
  }
  RAYMILL_ASSIGN_OR_RETURN(expansion_, StoreExpansion::create(*file_, share.threads, ledger_));
  return {};
}

bool StoreTracer::sorts(std::span<const Ray> rays) const {
  return order_claim_.bytes() > 0 && (config_.sort_rays == SortRays::always || RayOrder::is_scattered(rays));
}

bool StoreTracer::can_expand() const {
  return expansion_ && expansion_->has_pages() && !jobs_.empty() &&
         (config_.layout == Layout::expanded || stats_.rays_at_root >= file_->footer().triangle_count);
}

void StoreTracer::expand_page(Worker& worker, std::unique_lock<std::mutex>& lock) {
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

// Runs worker.rays, with a place for the hits that they find where they have lists.
StoreTracer::BatchCounters StoreTracer::trace_gathering(Worker& worker, TraceJob& job, const ExpandedTree* tree,
                                                        storage::PageId page, const std::byte* image) {
  if (job.crossings.empty()) {
    return trace_batch(worker, job, tree, page, image, nullptr);
  }
  struct Owner {
    StoreTracer& tracer;
    TraceJob& job;
  } owner{*this, job};
  const std::size_t room = job.crossings.size() / config_.share.threads;
  CrossingBuffer crossings{.room = std::span(job.crossings).subspan(worker.index * room, room),
                           .take =
                               [](void* to, std::span<const Crossing> some) {
                                 const auto& [tracer, of_job] = *static_cast<Owner*>(to);
                                 tracer.take_crossings(of_job, some);
                               },
                           .owner = &owner};
  const BatchCounters counters = trace_batch(worker, job, tree, page, image, &crossings);
  crossings.empty();
  return counters;
}

// Runs worker.rays. `tree`: of rays that begin, where there is one.
StoreTracer::BatchCounters StoreTracer::trace_batch(Worker& worker, const TraceJob& job, const ExpandedTree* tree,
                                                    storage::PageId page, const std::byte* image,
                                                    CrossingBuffer* crossings) {
  BatchCounters counters;
  const bool need_normal = has(job.config.fields, Field::normal);
  std::span<RayState> rays = worker.rays;
  if (tree != nullptr) {
    const auto others = std::partition(rays.begin(), rays.end(),
                                       [this](const RayState& ray) { return begins(ray, file_->footer().root_node); });
    ExpandedContext context{.tree = tree->view(),
                            .need_normal = need_normal,
                            .counters = {},
                            .filter = job.hit_filter(),
                            .crossings = crossings};
    counters.rays_expanded = static_cast<std::uint64_t>(others - rays.begin());
    job.expanded_kernel(context, rays.first(counters.rays_expanded));
    counters.kernel = context.counters;
    rays = rays.subspan(counters.rays_expanded);
    if (rays.empty()) {
      return counters;
    }
  }
  KernelContext context;
  context.images = worker.lone_page ? worker.lone_page->show(index_of(page), image) : cache_->images();
  context.touched = worker.page_lane ? worker.page_lane->marks() : cache_->touched();
  context.need_normal = need_normal;
  context.filter = job.hit_filter();
  context.crossings = crossings;
  job.kernel(context, rays);
  if (worker.lone_page) {
    worker.lone_page->settle(rays, image);
  }
  if (worker.page_lane) {
    worker.page_lane->end_batch(index_of(page), cache_->touched());
  }
  counters.kernel.nodes_visited += context.counters.nodes_visited;
  counters.kernel.pages_entered += context.counters.pages_entered;
  counters.kernel.triangles_tested += context.counters.triangles_tested;
  counters.corrupt = context.corrupt;
  return counters;
}

}  // namespace raymill::traversal
