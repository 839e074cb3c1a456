// BudgetPlan: how a store's share of the memory budget becomes frames, buffers and rays in flight.
//
//   share = fixed (tables, read buffers, decoders, workers, a buffer for rays to and from disk)
//         + frames x page size + jobs x (waiting rays and finished rows)
//
// Pages get what the decoded store needs, or else three quarters of what is left after the fixed part: rays that find
// no room in memory wait on disk, pages that find none are read again. Measured in out_of_core.md. Immutable values.
#pragma once

#include <cstdint>

#include "storage/base/status.h"
#include "storage/io/store_file.h"
#include "traversal/result_window.h"
#include "traversal/waiting_rays.h"

namespace raymill::traversal {

struct StoreShare {
  std::uint64_t bytes = 0;  ///< of the budget, for this store and its jobs
  unsigned threads = 1;
  unsigned max_jobs = 1;
};

struct BudgetPlan {
  unsigned read_depth = 0;
  std::uint32_t frame_count = 0;
  std::uint32_t group_pages = 0;   ///< pages whose rays go to disk and come back together
  std::size_t extent_bytes = 0;    ///< of rays that go at once
  std::uint64_t worker_bytes = 0;  ///< decoders, batches, stacks, the scheduler and the buffer for extents
  std::uint64_t job_bytes = 0;     ///< for each job: queues, rays, rows
  bool attributes = false;         ///< rows may have some
};

/// Memory of one job.
struct JobPlan {
  std::uint64_t most_in_flight = 0;
  WaitingRays::Config waiting;  ///< the layout and the directory are the job's to set
  ResultWindow::Config window;  ///< the directory is the job's to set
  std::uint32_t crossings = 0;  ///< hits that workers gather before they hand them over; for lists of hits
};

/// What a job answers.
struct RowsAsked {
  Field fields = kDefaultClosestFields;
  bool lists = false;       ///< of hits, for each ray; else a row a ray
  std::uint64_t first = 0;  ///< of a list so many hits; 0: all
};

/// The least share under which the store can be traced.
std::uint64_t least_share_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs);

/// Errors: budget_exceeded, naming the least share.
Result<BudgetPlan> plan_budget(const storage::StoreFile& store, const StoreShare& share);
/// The most rays and rows that the plan's job_bytes hold.
JobPlan plan_job(const BudgetPlan& plan, std::uint32_t page_count, const RowsAsked& rows);
/// What such a job claims.
std::uint64_t job_bytes(const JobPlan& plan);

}  // namespace raymill::traversal
