#include "traversal/budget_plan.h"

#include <algorithm>
#include <bit>
#include <span>

#include "storage/base/ledger.h"
#include "storage/cache/page_cache.h"
#include "storage/io/page_reader.h"
#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"
#include "traversal/future_demand.h"
#include "traversal/page_scheduler.h"
#include "traversal/store_tracer.h"

namespace raymill::traversal {
namespace {

// Pages. FACTS: direct random reads gain up to a depth of 8; neighbours come by one read. Fewer when memory is scarce.
constexpr unsigned kReadDepth = 16;
constexpr unsigned kLeastReadDepth = 2;
// Stack pages that a thread touches (40 KiB of lanes in a kernel), and what the C library keeps for it.
constexpr std::uint64_t kThreadBytes = 128 << 10;

// Records of a piece of a push, and its messages.
constexpr std::uint64_t kPushBytes = 128 << 10;

constexpr std::uint64_t kLeastChunks = 1024;  // half a megabyte: batches in hand, and an extent that comes back
constexpr std::uint64_t kMostChunks = std::uint64_t(1) << 20;
// Rays in flight: ten for each chunk in memory and the others on disk, fifty times as many; never more than in all,
// which is two gigabytes of disk.
constexpr std::uint64_t kRaysPerChunk = 512;
constexpr std::uint64_t kMostRays = std::uint64_t(1) << 25;
// Bytes of a ray on disk, about.
constexpr std::uint64_t kDiskRayBytes = 48;

// Rows get a quarter of what rays get.
constexpr std::uint64_t kLeastRowBytes = 192 << 10;
constexpr std::uint64_t kMostRowBytes = 64 << 20;
constexpr unsigned kLeastChunkShift = 8;  // 256 rays
constexpr unsigned kMostChunkShift = 16;  // 64 Ki rays: results come back in pieces of about a megabyte
constexpr std::size_t kLeastBlockBytes = 1 << 10;
constexpr std::size_t kMostBlockBytes = 16 << 10;
constexpr std::uint64_t kSlotBytes = 64;
constexpr std::uint64_t kRowSpan = 8;
constexpr unsigned kMostListShift = 12;     // rays of a chunk with lists: its hits are sorted together
constexpr std::uint64_t kListBlocks = 256;  // at least, where they may be so small

constexpr std::size_t kLeastExtentBytes = 32 << 10;
constexpr std::size_t kMostExtentBytes = 512 << 10;
constexpr std::uint32_t kMostGroupPages = 4096;

std::uint64_t worker_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs,
                           const BudgetPlan& plan) {
  const std::uint64_t of_attributes =
      store.has_attributes() ? kAttributeWorkerBytes + storage::attribute_decode_bytes(store.header().page_bytes) : 0;
  const std::uint64_t worker = of_attributes +
                               storage::PageDecoder::scratch_bytes(store.header().page_bytes, store.codec()) +
                               kWorkerBytes + kThreadBytes;
  return PageScheduler::bytes(store.page_count()) + FutureDemand::bytes(store.page_count(), max_jobs) +
         GroupTurns::bytes(store.page_count(), plan.group_pages) + storage::PageDecoder::process_bytes(store.codec()) +
         (std::min(plan.read_depth, storage::kMostReaderThreads) + 1) * kThreadBytes +
         WaitingRays::transfer_bytes(plan.extent_bytes) + max_jobs * kPushBytes + threads * worker;
}

static_assert(kLeastRowBytes / 16 / sizeof(Crossing) >= kMostThreads, "each worker gathers a hit at least");

// What does not depend on frames and jobs.
std::uint64_t fixed_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs,
                          const BudgetPlan& plan) {
  return worker_bytes(store, threads, max_jobs, plan) + storage::page_reader_bytes(store, plan.read_depth);
}

std::uint32_t least_frames(unsigned threads, unsigned depth) { return threads + depth + 2; }

std::uint64_t frame_cost(const storage::StoreFile& store, std::uint32_t frames) {
  return std::uint64_t(frames) * store.header().page_bytes +
         storage::PageCache::table_bytes(store.page_count(), frames);
}

// A group's pages fit half of the frames, so they stay while its rays come and go.
std::uint32_t group_pages(std::uint32_t frames) { return std::clamp(frames / 2, 1U, kMostGroupPages); }

// Half for chunks that are fetched, an eighth for the table of chunks, the rest for blocks: one for each chunk under
// way. Chunks under way hold kRowSpan times the rays in flight where blocks may be so small: a few late rays keep a
// chunk. Says how many rays that is enough for.
ResultWindow::Config plan_rows(std::uint64_t bytes, const HitLayout& row, std::uint64_t& rays) {
  ResultWindow::Config window;
  window.layout = row;
  const std::uint64_t held_rays = bytes / 2 / (ResultWindow::kMostHeld * row.row_bytes());
  window.chunk_shift =
      std::clamp(static_cast<unsigned>(std::bit_width(held_rays)) - 1, kLeastChunkShift, kMostChunkShift);
  const std::uint64_t most_slots = (std::uint64_t(1) << 32) >> window.chunk_shift;
  window.slots = static_cast<std::uint32_t>(std::min(bytes / 8 / kSlotBytes, most_slots));
  const std::uint64_t block_bytes = bytes * 3 / 8;
  window.block_bytes = std::clamp(std::size_t(std::bit_floor((block_bytes << window.chunk_shift) / (rays * kRowSpan))),
                                  kLeastBlockBytes, kMostBlockBytes);
  window.blocks = static_cast<std::uint32_t>(block_bytes / window.block_bytes);
  rays = std::min(rays, std::uint64_t(window.blocks) << window.chunk_shift);
  return window;
}

// The same for lists of hits: a quarter for pieces that are fetched, a quarter for blocks, an eighth to sort in, an
// eighth for the table of chunks, a sixteenth for hits that workers gather, the rest for tables.
ResultWindow::Config plan_lists(std::uint64_t bytes, const RowsAsked& asked, std::uint64_t& rays) {
  ResultWindow::Config window;
  window.layout = HitLayout(HitLists::kept(asked.fields));
  HitLists::Config& lists = window.lists;
  lists.asked = asked.fields;
  lists.first = asked.first;
  lists.pieces = ResultWindow::kMostHeld;
  lists.piece_bytes = bytes / 4 / lists.pieces;
  lists.sort_bytes = bytes / 8 / 64 * 64;
  // The offsets of a chunk's rays take a quarter of a piece at most.
  const std::uint64_t piece_rays = lists.piece_bytes / 4 / sizeof(std::uint32_t);
  window.chunk_shift =
      std::clamp(static_cast<unsigned>(std::bit_width(piece_rays)) - 1, kLeastChunkShift, kMostListShift);
  lists.chunk_rays = 1U << window.chunk_shift;
  window.slots = static_cast<std::uint32_t>(bytes / 8 / kSlotBytes);
  const std::uint64_t block_bytes = bytes / 4;
  window.block_bytes =
      std::clamp(std::size_t(std::bit_floor(block_bytes / kListBlocks)), kLeastBlockBytes, kMostBlockBytes);
  lists.block_bytes = window.block_bytes;
  window.blocks = static_cast<std::uint32_t>(block_bytes / window.block_bytes);
  rays = std::min(rays, std::uint64_t(window.blocks) << window.chunk_shift);
  return window;
}

JobPlan plan_for(std::uint64_t chunks, const BudgetPlan& plan, std::uint32_t page_count, const RowsAsked& asked) {
  JobPlan job;
  job.most_in_flight = std::min(chunks * kRaysPerChunk, kMostRays);
  const std::uint64_t row_bytes = std::clamp(chunks * kRayChunkBytes / 4, kLeastRowBytes, kMostRowBytes);
  if (asked.lists) {
    job.window = plan_lists(row_bytes, asked, job.most_in_flight);
    job.crossings = static_cast<std::uint32_t>(row_bytes / 16 / sizeof(Crossing));
  } else {
    job.window = plan_rows(row_bytes, HitLayout(asked.fields), job.most_in_flight);
  }
  WaitingRays::Config& waiting = job.waiting;
  waiting.page_count = page_count;
  waiting.group_pages = plan.group_pages;
  waiting.pool_chunks = static_cast<std::uint32_t>(chunks);
  waiting.extent_bytes = plan.extent_bytes;
  const std::uint64_t groups = page_count / plan.group_pages + 1;
  waiting.most_extents =
      static_cast<std::uint32_t>(4 * (job.most_in_flight * kDiskRayBytes / plan.extent_bytes + groups));
  return job;
}

// A row of each size that there is: 4, 8 and so on to 40 bytes.
constexpr Field kRowOfEachSize[] = {Field::t,
                                    Field::uv,
                                    Field::normal,
                                    Field::normal | Field::t,
                                    Field::normal | Field::uv,
                                    Field::normal | Field::uv | Field::t,
                                    Field::normal | Field::uv | Field::ids,
                                    Field::normal | Field::uv | Field::ids | Field::t,
                                    Field::all,
                                    Field::all | Field::count};

// The same of rows that attributes make longer: 44, 48 and so on to 80 bytes.
constexpr Field kWideRowOfEachSize[] = {
    Field::all | Field::uv0,
    Field::all | Field::shading_normal,
    Field::all | Field::color0,
    Field::all | Field::shading_normal | Field::uv0,
    Field::all | Field::color0 | Field::uv0,
    Field::all | Field::color0 | Field::shading_normal,
    Field::all | Field::color0 | Field::uv0 | Field::uv1,
    Field::all | Field::color0 | Field::shading_normal | Field::uv0,
    Field::attributes | Field::normal | Field::uv | Field::ids | Field::instance_id,
    Field::attributes | Field::all,
};

// The most that a job with so many chunks claims, whatever it answers: the smaller its rows, the more rays are in
// flight and the larger are their tables. What lists claim does not depend on their rows.
std::uint64_t job_bytes_for(std::uint64_t chunks, const BudgetPlan& plan, std::uint32_t page_count) {
  std::uint64_t most = job_bytes(plan_for(chunks, plan, page_count, {.lists = true}));
  for (const Field fields : kRowOfEachSize) {
    most = std::max(most, job_bytes(plan_for(chunks, plan, page_count, {.fields = fields})));
  }
  for (const Field fields : plan.attributes ? std::span<const Field>(kWideRowOfEachSize) : std::span<const Field>()) {
    most = std::max(most, job_bytes(plan_for(chunks, plan, page_count, {.fields = fields})));
  }
  return most;
}

}  // namespace

std::uint64_t job_bytes(const JobPlan& plan) {
  return WaitingRays::table_bytes(plan.waiting) + std::uint64_t(plan.waiting.pool_chunks) * kRayChunkBytes +
         ResultWindow::bytes(plan.window) + plan.crossings * sizeof(Crossing);
}

std::uint64_t least_share_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs) {
  const std::uint32_t frames = std::min(store.page_count(), least_frames(threads, kLeastReadDepth));
  BudgetPlan least;
  least.read_depth = kLeastReadDepth;
  least.group_pages = group_pages(frames);
  least.extent_bytes = kLeastExtentBytes;
  least.attributes = store.has_attributes();
  return fixed_bytes(store, threads, max_jobs, least) + frame_cost(store, frames) +
         max_jobs * job_bytes_for(kLeastChunks, least, store.page_count());
}

Result<BudgetPlan> plan_budget(const storage::StoreFile& store, const StoreShare& share) {
  const std::uint64_t least = least_share_bytes(store, share.threads, share.max_jobs);
  if (share.bytes < least) {
    return {ErrorCode::budget_exceeded, "needs at least " + storage::format_bytes(least) +
                                            " beside the process itself, " + storage::format_bytes(share.bytes) +
                                            " left"};
  }
  BudgetPlan plan;
  plan.attributes = store.has_attributes();
  plan.group_pages = 1;  // the most tables: what follows is an upper bound
  const auto jobs = [&](std::uint64_t chunks) {
    return share.max_jobs * job_bytes_for(chunks, plan, store.page_count());
  };
  const auto least_count = [&] { return std::min(store.page_count(), least_frames(share.threads, plan.read_depth)); };
  const auto fits = [&](unsigned frame_factor) {
    return jobs(kLeastChunks) + fixed_bytes(store, share.threads, share.max_jobs, plan) +
               frame_factor * frame_cost(store, least_count()) <=
           share.bytes;
  };
  // Deep read queues and large extents are worth their buffers only where they are small beside the pages.
  plan.read_depth = kReadDepth;
  plan.extent_bytes = std::clamp(std::size_t(std::bit_floor(share.bytes / 128)), kLeastExtentBytes, kMostExtentBytes);
  while (plan.extent_bytes > kLeastExtentBytes && !fits(4)) {
    plan.extent_bytes /= 2;
  }
  while (plan.read_depth > kLeastReadDepth && !fits(4)) {
    --plan.read_depth;
  }
  const std::uint64_t tables = storage::PageCache::table_bytes(store.page_count(), 0);
  const std::uint64_t rest = share.bytes - fixed_bytes(store, share.threads, share.max_jobs, plan) - tables;
  const std::uint64_t per_frame = frame_cost(store, 1) - tables;
  std::uint64_t page_bytes = std::max(rest - rest / 4, rest - std::min(rest, jobs(kMostChunks)));
  page_bytes = std::min(page_bytes, rest - std::min(rest, jobs(kLeastChunks)));
  plan.frame_count = static_cast<std::uint32_t>(
      std::min<std::uint64_t>(store.page_count(), std::max<std::uint64_t>(page_bytes / per_frame, least_count())));
  plan.group_pages = group_pages(plan.frame_count);
  plan.worker_bytes = worker_bytes(store, share.threads, share.max_jobs, plan);
  plan.job_bytes = (rest - plan.frame_count * per_frame) / share.max_jobs;
  return plan;
}

JobPlan plan_job(const BudgetPlan& plan, std::uint32_t page_count, const RowsAsked& rows) {
  std::uint64_t low = kLeastChunks, high = kMostChunks;
  while (low < high) {
    const std::uint64_t middle = (low + high + 1) / 2;
    const bool fits = job_bytes(plan_for(middle, plan, page_count, rows)) <= plan.job_bytes;
    (fits ? low : high) = fits ? middle : middle - 1;
  }
  return plan_for(low, plan, page_count, rows);
}

}  // namespace raymill::traversal
