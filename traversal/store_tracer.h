// StoreTracer: one open store with its pages, its workers and the jobs that run on it.
//
//                 push() --rays--> queue of the root page; or, where the store is expanded, blocks of fresh rays
//                                     |
//        +---------- ready page <-----+-----------------------+
//        v                                                    |
//   worker: take a batch, pin, kernel --done--> rows, chunk   |
//        |                                                    |
//        +--parked--> queue of an absent page --wanted--> reader --arrival--> worker decodes, publishes
//                            |       ^
//                            v       |
//                     rays on disk, by group of pages (ray_spiller.h)
//
// One mutex guards the scheduler, the queues and the windows; kernels, decoding and all transfers run outside it. No
// thread waits for a page: rays do. Thread-safe.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/cache/page_cache.h"
#include "storage/io/page_reader.h"
#include "storage/io/store_file.h"
#include "storage/pages/attribute_page.h"
#include "storage/pages/codec.h"
#include "traversal/budget_plan.h"
#include "traversal/fresh_rays.h"
#include "traversal/future_demand.h"
#include "traversal/group_turns.h"
#include "traversal/kernel.h"
#include "traversal/page_scheduler.h"
#include "traversal/page_trace.h"
#include "traversal/ray_order.h"
#include "traversal/ray_spiller.h"
#include "traversal/service.h"
#include "traversal/store_expansion.h"
#include "traversal/timeline.h"
#include "traversal/volume/volume_kernel.h"

namespace raymill::traversal {

class TraceJob;

/// Rays that a worker runs between two looks at the queues: large enough to pay for the lock, small enough that an
/// evicted page's frame rests for about a millisecond.
constexpr std::uint32_t kBatchRays = 512;
constexpr unsigned kMostThreads = 256;  ///< workers of one store
/// Chunks are taken out whole: a batch may have the rays of one more.
constexpr std::uint32_t kBatchSlack = RayPool::records_per_chunk(RecordLayout::kLeastBytes);
/// Rays of a push that are sorted together.
constexpr std::size_t kSortedRays = std::size_t{64} << 10;
/// Answers of a block of fresh rays, and their entries in the result window.
constexpr std::uint64_t kFreshWorkerBytes = FreshRays::kBlockRays * (2 * sizeof(Hit) + sizeof(std::uint16_t));
/// Of a store with attributes: those of a batch's rays.
constexpr std::uint64_t kAttributeWorkerBytes = (kBatchRays + kBatchSlack) * sizeof(HitAttributes);
/// A batch, and the order in which its rays are parked.
constexpr std::uint64_t kWorkerBytes = (kBatchRays + kBatchSlack) * (sizeof(RayState) + 2 * sizeof(std::uint64_t));

class StoreTracer {
 public:
  struct Config {
    StoreShare share;
    Isa isa = Isa::scalar;
    ReadOrder read_order = ReadOrder::score;
    storage::EvictionKind eviction = storage::EvictionKind::clock;
    Layout layout = Layout::automatic;
    SortRays sort_rays = SortRays::automatic;
    bool adversarial = false;
    std::shared_ptr<PageTrace> page_trace;  ///< none: nothing is recorded
    storage::ReaderKind io = storage::ReaderKind::automatic;
    std::function<decltype(storage::make_page_reader)> make_reader;  ///< for tests; none: storage's
    std::string spill_directory;
    std::shared_ptr<Timeline> timeline;  ///< none: nothing is recorded
  };
  /// Errors: budget_exceeded.
  static Result<std::shared_ptr<StoreTracer>> create(std::shared_ptr<const storage::StoreFile> file,
                                                     const Config& config, storage::Ledger& ledger);
  ~StoreTracer();

  [[nodiscard]] const storage::StoreFile& file() const { return *file_; }
  /// Errors: invalid_argument (fields), busy_retry (max_jobs are running), budget_exceeded.
  Result<std::unique_ptr<Job>> start(const TraceConfig& config, std::shared_ptr<StoreTracer> self);

 private:
  friend class TraceJob;
  friend class EngineJob;
  friend class RaySpiller;
  struct Worker;
  class WorkLock;
  class Gathering;
  struct StoreStats {
    std::uint64_t pages_read = 0;
    std::uint64_t stalls = 0;
    std::uint64_t depths = 0;  // pages under way when each read began, added up
    std::uint64_t bytes_read = 0;
    std::uint64_t distinct_pages = 0;
    std::uint64_t distinct_bytes = 0;
    double decode_seconds = 0;
    double expand_seconds = 0;
    std::uint64_t rays_at_root = 0;  // that a worker took there
    double idle_seconds = 0;
    double lock_wait_seconds = 0;
    double lock_hold_seconds = 0;
  };

  /// A job gets more rays soon when its pusher was there so short a time ago.
  static constexpr std::chrono::milliseconds kPushPatience{10};

  StoreTracer(std::shared_ptr<const storage::StoreFile> file, const Config& config, storage::Ledger& ledger);
  Status init();
  [[nodiscard]] std::uint64_t aside_bytes() const;

  void work(unsigned index);
  Status plan_memory(const StoreShare& share);
  Status plan_layout(const StoreShare& share);
  [[nodiscard]] bool stays_in_memory() const;
  [[nodiscard]] bool sorts(std::span<const Ray> rays) const;
  [[nodiscard]] bool can_expand() const;
  /// Whether the job's rays go to the expanded layout from now on, be it that they wait for it.
  [[nodiscard]] bool takes_fresh(const TraceJob& job) const;
  [[nodiscard]] bool has_fresh() const;
  std::shared_ptr<TraceJob> next_job(const std::function<bool(const TraceJob&)>& has_it);
  [[nodiscard]] bool push_goes_on(const TraceJob& job) const;
  void run_fresh(Worker& worker, WorkLock& lock);
  struct FreshAnswers {
    KernelCounters kernel;
    std::uint64_t hits = 0;     // rays with at least one
    std::uint64_t counted = 0;  // crossings, where they are counted
  };
  FreshAnswers trace_fresh(Worker& worker, TraceJob& job, const FreshRays::Block& block);
  static Result<bool> settle_fresh(const Worker& worker, TraceJob& job, const FreshRays::Block& block,
                                   const FreshAnswers& answers);
  void expand_page(Worker& worker, WorkLock& lock);
  void end_expansion(Result<std::unique_ptr<ExpandedTree>> tree);
  [[nodiscard]] std::uint64_t expansion_bytes(const StoreShare& share) const;
  struct BatchCounters {
    KernelCounters kernel;
    std::uint64_t attributes_read = 0;
    bool corrupt = false;
  };
  BatchCounters trace_batch(Worker& worker, const TraceJob& job, storage::PageId page, const std::byte* image,
                            CrossingBuffer* crossings);
  BatchCounters trace_rays(Worker& worker, const TraceJob& job, storage::PageId page, const std::byte* image,
                           CrossingBuffer* crossings);
  BatchCounters trace_volumes(Worker& worker, const TraceJob& job, storage::PageId page,
                              CrossingBuffer* crossings) const;
  void wait_for_work(WorkLock& lock);
  void handle_arrival(Worker& worker, WorkLock& lock);
  void run_batch(Worker& worker, storage::PageId page, WorkLock& lock);
  [[nodiscard]] std::uint32_t batch_size(const TraceJob& job) const;
  void take_crossings(TraceJob& job, std::span<const Crossing> crossings);
  Result<bool> settle(Worker& worker, TraceJob& job);
  [[nodiscard]] bool more_rays_come() const;
  [[nodiscard]] std::optional<storage::PageId> page_to_read();
  [[nodiscard]] std::unique_ptr<GroupTurns> make_turns() const;
  /// What a read of each page costs.
  static std::function<std::uint32_t(std::uint32_t)> encoded_bytes(const storage::StoreFile& store);
  [[nodiscard]] storage::PageDemand page_demand() const;
  void pump_reads();
  [[nodiscard]] std::uint32_t low_water(const TraceJob& job) const;
  [[nodiscard]] bool has_room(const TraceJob& job) const;
  void unstall();
  void on_arrival(storage::PageArrival arrival);
  [[nodiscard]] PageState state_of(storage::PageId page) const;
  [[nodiscard]] storage::PageId root_page() const { return storage::PageId{file_->footer().root_page}; }
  [[nodiscard]] Status check_query(const TraceConfig& config) const;
  [[nodiscard]] Status check_attributes(const TraceConfig& config) const;
  void fail_waiting(storage::PageId page, const Status& status);
  void remove_job(TraceJob& job);

  const std::shared_ptr<const storage::StoreFile> file_;
  std::vector<storage::Volume> volumes_;  // by their index; set once
  const storage::AttributePlaces attribute_places_;
  const Config config_;
  storage::Ledger& ledger_;
  storage::BudgetReservation workers_claim_;
  storage::BudgetReservation order_claim_;  // empty: rays are taken as they come
  storage::BudgetReservation fresh_claim_;  // empty: the store keeps its layout
  BudgetPlan plan_;
  std::unique_ptr<storage::PageCache> cache_;
  std::shared_ptr<FutureDemand> future_demand_;  // none: eviction does not ask for it

  std::mutex mutex_;
  std::condition_variable work_wake_;  // workers: something to do
  PageScheduler scheduler_;
  std::unique_ptr<GroupTurns> turns_;
  std::unique_ptr<StoreExpansion> expansion_;  // none: compact, or done
  std::shared_ptr<const ExpandedTree> tree_;
  Status layout_status_;  // why there is no tree, where one was asked for
  std::vector<storage::PageArrival> arrivals_;
  struct Reading {
    storage::FrameLease lease;
    Timeline::Clock::time_point begin;
  };
  std::vector<Reading> readings_;  // under way
  std::vector<bool> was_read_;     // for distinct_pages
  std::vector<std::shared_ptr<TraceJob>> jobs_;
  std::size_t next_job_ = 0;  // round robin
  StoreStats stats_;
  bool stalled_ = false;  // batches wait for room in a job's memory
  bool stopping_ = false;

  std::unique_ptr<storage::PageReader> reader_;
  std::unique_ptr<RaySpiller> spiller_;
  std::vector<std::thread> threads_;
};

}  // namespace raymill::traversal
