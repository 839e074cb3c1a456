// TraceJob: one batch of rays on a StoreTracer: its waiting rays, its rows, its end.
//
// Everything here is guarded by the tracer's mutex but what somebody holds in its hands: the rays of a worker's batch,
// and those on their way to disk or back. Thread-compatible under that mutex.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "traversal/fresh_rays.h"
#include "traversal/future_demand.h"
#include "traversal/kernel.h"
#include "traversal/result_window.h"
#include "traversal/service.h"
#include "traversal/waiting_rays.h"

namespace raymill::traversal {

class TraceJob {
 public:
  using Clock = std::chrono::steady_clock;

  struct Setup {
    TraceConfig config;
    Kernel kernel = nullptr;
    ExpandedKernel expanded_kernel = nullptr;
    std::string kernel_name;
    std::unique_ptr<WaitingRays> waiting;
    std::unique_ptr<ResultWindow> window;
    std::unique_ptr<FreshRays> fresh;  ///< none: the store keeps its layout
    storage::BudgetReservation crossings_claim;
    std::vector<Crossing> crossings;
    std::uint64_t most_in_flight = 0;
    std::unique_ptr<FutureDemand::Share> future_demand;  ///< none: eviction does not ask for it
    storage::PageId start_page{0};
    bool among_volumes = false;
  };
  explicit TraceJob(Setup setup);

  /// Whether the ray can be traced (query.h).
  static bool valid(const Ray& ray);

  // Set once.
  const TraceConfig config;
  const HitFilter filter;  ///< of the config
  [[nodiscard]] const HitFilter* hit_filter() const {
    return filter.skips || !filter.geometry_masks.empty() ? &filter : nullptr;
  }
  const Footprint tolerance;  ///< of the config
  /// Null: every subtree is entered.
  [[nodiscard]] const Footprint* footprint() const {
    return tolerance.length > 0 || tolerance.angle > 0 ? &tolerance : nullptr;
  }
  const Kernel kernel;
  const ExpandedKernel expanded_kernel;
  const std::string kernel_name;
  const std::uint64_t most_in_flight;
  const std::unique_ptr<FutureDemand::Share> future_demand;
  const storage::PageId start_page;  ///< where rays begin
  const bool among_volumes;          ///< rays go among volumes, at once or after the triangles

  const storage::BudgetReservation crossings_claim;
  /// Hits that workers have not handed over yet, the same number for each; none where rays have no lists.
  std::vector<Crossing> crossings;

  // Under the tracer's mutex.
  std::unique_ptr<WaitingRays> waiting;
  std::unique_ptr<ResultWindow> window;
  std::unique_ptr<FreshRays> fresh;  ///< none: rays go through pages
  Status status;                     ///< not ok: the job has ended early
  bool finished = false;             ///< no more rays come
  unsigned batches_out = 0;          ///< workers that hold rays of this job
  bool push_blocked = false;         ///< push() waits until there is place for many
  bool push_needs_room = false;      ///< push() waits until there is room for waiting rays
  Clock::time_point last_push{};
  JobStats stats;
  std::uint64_t rays_pushed = 0;
  std::uint64_t rays_done = 0;
  [[nodiscard]] std::uint64_t in_flight() const { return rays_pushed - rays_done; }
  /// Whether a ray more may be in flight (where it then waits is another matter), and whether a quarter of all may.
  [[nodiscard]] bool place_for_one() const;
  [[nodiscard]] bool place_for_many() const;
  Clock::time_point first_push{}, last_done{};
  std::condition_variable changed;  ///< a slot is free or done, there is room, or the job ended
};

}  // namespace raymill::traversal
