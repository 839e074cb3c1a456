#include "traversal/budget_plan.h"

#include <algorithm>
#include <bit>

#include "storage/base/ledger.h"
#include "storage/cache/page_cache.h"
#include "storage/io/page_reader.h"
#include "storage/pages/codec.h"
#include "traversal/future_demand.h"
#include "traversal/page_scheduler.h"
#include "traversal/ray_pool.h"
#include "traversal/result_window.h"
#include "traversal/store_tracer.h"

namespace raymill::traversal {
namespace {

// FACTS: direct random reads gain up to a depth of 8; fewer when memory is scarce.
constexpr unsigned kReadDepth = 8;
constexpr unsigned kLeastReadDepth = 2;
// Stack pages that a thread touches, and what the C library keeps for it.
constexpr std::uint64_t kThreadBytes = 96 << 10;

constexpr unsigned kLeastChunkShift = 8;  // 256 rays
constexpr unsigned kMostChunkShift = 16;  // 64 Ki rays: results come back in pieces of about a megabyte
constexpr std::uint64_t kLeastRays = std::uint64_t(ResultWindow::kMinBlocks) << kLeastChunkShift;
constexpr std::uint64_t kMostRays = std::uint64_t(1) << 23;
constexpr std::uint64_t kManyRays = std::uint64_t(1) << 20;
// Rows in memory for each ray in flight. Those of rays that are done while others of their chunk are not take the
// places of stragglers, whose rows are kept apart.
constexpr std::uint64_t rows_for(std::uint64_t rays) { return rays; }
constexpr std::uint64_t stragglers_for(std::uint64_t rays) { return rays - rays / 4; }
static_assert(rows_for(kMostRays) * ResultWindow::kSlotsPerBlock <= 0xFFFFFFFFu, "a ray's number has 32 bits");
// Every field and a full bitstack.
constexpr std::size_t kLargestRow = 36;
constexpr std::size_t kLargestRecord = 35 + sizeof(Bitstack);

std::uint64_t worker_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs, unsigned depth) {
  const std::uint64_t worker =
      storage::PageDecoder::scratch_bytes(store.header().page_bytes, store.codec()) + kWorkerBytes + kThreadBytes;
  return PageScheduler::bytes(store.page_count()) + FutureDemand::bytes(store.page_count(), max_jobs) +
         storage::PageDecoder::process_bytes(store.codec()) + depth * kThreadBytes + threads * worker;
}

// What does not depend on the share.
std::uint64_t fixed_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs, unsigned depth) {
  return worker_bytes(store, threads, max_jobs, depth) + storage::page_reader_bytes(store, depth);
}

std::uint32_t least_frames(unsigned threads, unsigned depth) { return threads + depth + 2; }

std::uint64_t frame_cost(const storage::StoreFile& store, std::uint32_t frames) {
  return std::uint64_t(frames) * store.header().page_bytes +
         storage::PageCache::table_bytes(store.page_count(), frames);
}

// The window of so many rays in flight.
WindowPlan window_for(std::uint64_t rays) {
  const std::uint64_t rows = rows_for(rays);
  WindowPlan plan;
  plan.most_in_flight = static_cast<std::uint32_t>(rays);
  plan.chunk_shift =
      std::clamp<unsigned>(static_cast<unsigned>(std::bit_width(rows / 32)) - 1, kLeastChunkShift, kMostChunkShift);
  plan.blocks = static_cast<std::uint32_t>(rows >> plan.chunk_shift);
  plan.most_stragglers = static_cast<std::uint32_t>(stragglers_for(rays));
  return plan;
}

std::uint64_t job_bytes(std::uint64_t rays, std::uint32_t page_count, std::size_t record_bytes, std::size_t row_bytes) {
  const WindowPlan window = window_for(rays);
  return page_count * sizeof(RayQueue) +
         ResultWindow::bytes(window.chunk_shift, window.blocks, window.most_stragglers, row_bytes) +
         RayPool::chunks_needed(rays, page_count, record_bytes) * kRayChunkBytes;
}

std::uint64_t least_job_bytes(const storage::StoreFile& store) {
  return job_bytes(kLeastRays, store.page_count(), kLargestRecord, kLargestRow);
}

}  // namespace

std::uint64_t least_share_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs) {
  return fixed_bytes(store, threads, max_jobs, kLeastReadDepth) +
         frame_cost(store, std::min(store.page_count(), least_frames(threads, kLeastReadDepth))) +
         max_jobs * least_job_bytes(store);
}

Result<BudgetPlan> plan_budget(const storage::StoreFile& store, const StoreShare& share) {
  const std::uint64_t least = least_share_bytes(store, share.threads, share.max_jobs);
  if (share.bytes < least) {
    return {ErrorCode::budget_exceeded, "needs at least " + storage::format_bytes(least) +
                                            " beside the process itself, " + storage::format_bytes(share.bytes) +
                                            " left"};
  }
  BudgetPlan plan;
  // A deep read queue is worth its buffers only where they are small beside the pages.
  plan.read_depth = kReadDepth;
  const std::uint64_t least_jobs = share.max_jobs * least_job_bytes(store);
  while (plan.read_depth > kLeastReadDepth &&
         least_jobs + fixed_bytes(store, share.threads, share.max_jobs, plan.read_depth) +
                 4 * frame_cost(store, std::min(store.page_count(), least_frames(share.threads, plan.read_depth))) >
             share.bytes) {
    --plan.read_depth;
  }
  const std::uint64_t rest = share.bytes - fixed_bytes(store, share.threads, share.max_jobs, plan.read_depth) -
                             storage::PageCache::table_bytes(store.page_count(), 0);
  const std::uint64_t per_frame = frame_cost(store, 1) - storage::PageCache::table_bytes(store.page_count(), 0);
  const std::uint64_t all_frames = store.page_count() * per_frame;
  const std::uint64_t most_job = share.max_jobs * job_bytes(kMostRays, store.page_count(), kLargestRecord, kLargestRow);
  // Rays come first where they are few: a read serves as many rays as wait, so under a small budget a ray more saves
  // more reads than a page more (measured at 5 % of a 60 M store: a fifth fewer reads with two thirds for rays than
  // with half).
  const std::uint64_t many_rays =
      share.max_jobs * job_bytes(kManyRays, store.page_count(), kLargestRecord, kLargestRow);
  std::uint64_t page_bytes =
      std::max({rest / 3, std::min(rest / 2, rest - std::min(rest, many_rays)), rest - std::min(rest, most_job)});
  page_bytes = std::min({page_bytes, all_frames, rest - std::min(rest, least_jobs)});
  plan.frame_count = static_cast<std::uint32_t>(std::max<std::uint64_t>(
      page_bytes / per_frame, std::min(store.page_count(), least_frames(share.threads, plan.read_depth))));
  plan.frame_count = std::min(plan.frame_count, store.page_count());
  plan.worker_bytes = worker_bytes(store, share.threads, share.max_jobs, plan.read_depth);
  plan.job_bytes = std::min((rest - plan.frame_count * per_frame) / share.max_jobs, most_job / share.max_jobs);
  return plan;
}

WindowPlan plan_window(std::uint64_t bytes, std::uint32_t page_count, std::size_t record_bytes, std::size_t row_bytes) {
  std::uint64_t low = kLeastRays, high = kMostRays;
  while (low < high) {
    const std::uint64_t middle = (low + high + 1) / 2;
    const bool fits = job_bytes(middle, page_count, record_bytes, row_bytes) <= bytes;
    (fits ? low : high) = fits ? middle : middle - 1;
  }
  WindowPlan plan = window_for(low);
  plan.pool_chunks = static_cast<std::uint32_t>(RayPool::chunks_needed(low, page_count, record_bytes));
  return plan;
}

}  // namespace raymill::traversal
