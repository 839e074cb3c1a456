// TraceJob: one batch of rays on a StoreTracer: its waiting rays, its rows, its end.
//
// Everything here is guarded by the tracer's mutex but what a worker holds in its hands: the rays of its batch and
// their rows. Thread-compatible under that mutex.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <vector>

#include "storage/base/ledger.h"
#include "traversal/future_demand.h"
#include "traversal/kernel.h"
#include "traversal/ray_pool.h"
#include "traversal/ray_state.h"
#include "traversal/result_window.h"
#include "traversal/service.h"

namespace raymill::traversal {

class StoreTracer;

class TraceJob {
 public:
  struct Setup {
    TraceConfig config;
    Kernel kernel = nullptr;
    std::string kernel_name;
    RecordLayout layout;
    std::unique_ptr<RayPool> pool;
    std::unique_ptr<ResultWindow> window;
    std::unique_ptr<FutureDemand::Share> future_demand;  ///< none: eviction does not ask for it
    storage::BudgetReservation queues_claim;
    std::uint32_t page_count = 0;
    std::uint32_t most_in_flight = 0;
  };
  explicit TraceJob(Setup setup);

  /// Whether the ray can be traced (query.h).
  static bool valid(const Ray& ray);

  // Set once.
  const TraceConfig config;
  const Kernel kernel;
  const std::string kernel_name;
  const RecordLayout layout;
  const std::uint32_t most_in_flight;
  const std::unique_ptr<FutureDemand::Share> future_demand;

  // Under the tracer's mutex.
  std::unique_ptr<RayPool> pool;
  std::unique_ptr<ResultWindow> window;
  std::vector<RayQueue> queues;  ///< [page]
  Status status;                 ///< not ok: the job has ended early
  bool finished = false;         ///< no more rays come
  unsigned batches_out = 0;      ///< workers that hold rays of this job
  bool push_blocked = false;     ///< push() waits
  bool rows_exhausted = false;   ///< it waits for rows, not for rays
  std::chrono::steady_clock::time_point last_push{};
  JobStats stats;
  std::uint64_t rays_pushed = 0;
  std::uint64_t rays_done = 0;
  [[nodiscard]] std::uint64_t in_flight() const { return rays_pushed - rays_done; }
  std::chrono::steady_clock::time_point first_push{}, last_done{};
  std::condition_variable changed;  ///< a slot is free or done, or the job ended

 private:
  storage::BudgetReservation queues_claim_;
};

}  // namespace raymill::traversal
