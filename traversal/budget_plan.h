// BudgetPlan: how a store's share of the memory budget becomes frames, buffers and rays in flight.
//
//   share = fixed (tables, read buffers, decoders, workers) + frames x page size + jobs x (rays and their rows)
//
// Pages get what the decoded store needs; where that is more than there is, rays get what a million of them take, at
// least half and at most two thirds of what is left after the fixed part. Measured in out_of_core.md. Immutable values.
#pragma once

#include <cstdint>

#include "storage/base/status.h"
#include "storage/io/store_file.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

struct StoreShare {
  std::uint64_t bytes = 0;  ///< of the budget, for this store and its jobs
  unsigned threads = 1;
  unsigned max_jobs = 1;
};

struct BudgetPlan {
  unsigned read_depth = 0;
  std::uint32_t frame_count = 0;
  std::uint64_t worker_bytes = 0;  ///< decoders, batches, stacks and the scheduler
  std::uint64_t job_bytes = 0;     ///< for each job: queues, rays, rows
};

/// Rays of one job. Rows reach further than rays in flight: new rays take the places of those that are done before
/// their chunk is.
struct WindowPlan {
  std::uint32_t most_in_flight = 0;
  std::uint32_t pool_chunks = 0;
  unsigned chunk_shift = 0;  ///< rows in memory: blocks << chunk_shift
  std::uint32_t blocks = 0;
  std::uint32_t most_stragglers = 0;
};

/// The least share under which the store can be traced.
std::uint64_t least_share_bytes(const storage::StoreFile& store, unsigned threads, unsigned max_jobs);

/// Errors: budget_exceeded, naming the least share.
Result<BudgetPlan> plan_budget(const storage::StoreFile& store, const StoreShare& share);
/// The largest window that `job_bytes` hold.
WindowPlan plan_window(std::uint64_t job_bytes, std::uint32_t page_count, std::size_t record_bytes,
                       std::size_t row_bytes);

}  // namespace raymill::traversal
