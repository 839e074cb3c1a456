#include "traversal/engine_job.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "traversal/simd/float_mode.h"

namespace raymill::traversal {
namespace {

// Rays that are made into records between two locks.
constexpr std::size_t kPieceRays = 1024;
// Of a timeline; workers have the lanes below it.
constexpr unsigned kPushLane = 1000;

}  // namespace

// Gives the slot back when the caller lets go of the chunk; keeps the job's memory until then.
class EngineJob::ChunkOwner final : public HitChunk::Owner {
 public:
  ChunkOwner(std::shared_ptr<StoreTracer> tracer, std::shared_ptr<TraceJob> job, std::uint32_t slot)
      : tracer_(std::move(tracer)), job_(std::move(job)), slot_(slot) {}
  ~ChunkOwner() override {
    {
      const std::lock_guard lock(tracer_->mutex_);
      job_->window->free_slot(slot_);
    }
    job_->changed.notify_all();
  }

 private:
  std::shared_ptr<StoreTracer> tracer_;
  std::shared_ptr<TraceJob> job_;
  std::uint32_t slot_;
};

EngineJob::EngineJob(std::shared_ptr<StoreTracer> tracer, std::shared_ptr<TraceJob> job)
    : tracer_(std::move(tracer)), job_(std::move(job)) {}

EngineJob::~EngineJob() {
  std::unique_lock lock(tracer_->mutex_);
  end(lock, {ErrorCode::cancelled, "the job was dropped before it was done"});
  // Workers still write rows of their batches.
  job_->changed.wait(lock, [this] { return job_->batches_out == 0; });
}

void EngineJob::end(std::unique_lock<std::mutex>& /*lock*/, const Status& status) {
  const bool all_done = job_->finished && job_->rays_done == job_->rays_pushed;
  if (job_->status.ok() && !all_done) {
    job_->status = status;
  }
  tracer_->remove_job(*job_);
  job_->changed.notify_all();
}

void EngineJob::cancel() {
  std::unique_lock lock(tracer_->mutex_);
  if (job_->status.ok()) {
    job_->status = {ErrorCode::cancelled, "the job was cancelled"};
    end(lock, job_->status);
  }
}

Status EngineJob::push(std::span<const Ray> rays) {
  const IeeeScope ieee;
  while (!rays.empty()) {
    const std::size_t count = std::min(rays.size(), kPieceRays);
    RAYMILL_RETURN_IF_ERROR(push_some(rays.first(count)));
    rays = rays.subspan(count);
  }
  return {};
}

// Waits for the job's next change; the scheduler knows meanwhile that no rays are to come.
void EngineJob::wait_blocked(std::unique_lock<std::mutex>& lock, bool for_rows) {
  job_->push_blocked = true;
  job_->rows_exhausted = for_rows;
  tracer_->pump_reads();
  job_->changed.wait(lock);
  job_->push_blocked = job_->rows_exhausted = false;
}

// Brings all rays back to their queues, then takes the rows of nearly finished chunks out of memory.
Status EngineJob::spill_open_chunks(std::unique_lock<std::mutex>& lock) {
  ++tracer_->holds_;
  job_->changed.wait(lock, [this] { return job_->batches_out == 0; });
  const auto begin = Timeline::Clock::now();
  Status status = job_->status.ok() ? job_->window->spill_open() : job_->status;
  if (const auto& timeline = tracer_->config_.timeline) {
    timeline->span(kPushLane, "spill results", begin, "spilled_bytes", job_->window->spilled_bytes());
  }
  --tracer_->holds_;
  tracer_->work_wake_.notify_all();
  return status;
}

// Waits until a ray more may be in flight and has a row. Where rows are short, finished chunks that nobody fetches and
// chunks that a few late rays hold up go to disk.
Status EngineJob::make_room(std::unique_lock<std::mutex>& lock) {
  ResultWindow& window = *job_->window;
  while (job_->status.ok()) {
    if (job_->in_flight() >= job_->most_in_flight) {
      wait_blocked(lock, false);
      continue;
    }
    if (window.room() > 0) {
      return {};
    }
    if (window.filling()) {
      window.close_slot();
      job_->changed.notify_all();
    }
    if (window.begin_slot()) {
      continue;
    }
    if (!window.short_of_blocks()) {
      wait_blocked(lock, true);  // the oldest chunk is too far behind
      continue;
    }
    Result<bool> spilled = window.spill_done();
    if (spilled && !*spilled && window.can_spill_open()) {
      const Status status = spill_open_chunks(lock);
      spilled = status.ok() ? Result<bool>(true) : Result<bool>(status);
    }
    if (!spilled) {
      job_->status = job_->status.ok() ? spilled.status() : job_->status;
      end(lock, job_->status);
    } else if (!*spilled) {
      wait_blocked(lock, true);
    }
  }
  return job_->status;
}

Status EngineJob::push_some(std::span<const Ray> rays) {
  const storage::StoreFooter& footer = tracer_->file().footer();
  const storage::PageId root{footer.root_page};
  while (!rays.empty()) {
    std::unique_lock lock(tracer_->mutex_);
    if (job_->finished) {
      return {ErrorCode::invalid_argument, "rays were pushed after finish()"};
    }
    RAYMILL_RETURN_IF_ERROR(make_room(lock));
    ResultWindow& window = *job_->window;
    const auto count = static_cast<std::uint32_t>(
        std::min<std::uint64_t>({rays.size(), window.room(), job_->most_in_flight - job_->in_flight()}));
    const std::uint32_t first_number = window.next_number();
    const bool need_tnears =
        std::any_of(rays.begin(), rays.begin() + count, [](const Ray& ray) { return ray.tnear != 0; });
    float* tnears = need_tnears ? window.tnears_of_filling() : nullptr;
    lock.unlock();

    const RowTable& rows = window.rows();
    const std::size_t record_bytes = job_->layout.bytes();
    records_.resize(count * record_bytes);
    std::uint32_t valid_count = 0;
    std::vector<std::uint32_t> invalid;
    for (std::uint32_t i = 0; i < count; ++i) {
      const Ray& ray = rays[i];
      const std::uint32_t number = first_number + i;
      Hit miss;
      if (!TraceJob::valid(ray)) {
        miss.t = std::numeric_limits<float>::quiet_NaN();
        invalid.push_back(number);
      } else {
        RayState state;
        state.org = ray.org;
        state.dir = ray.dir;
        // A hit has a finite t; beyond float32 lies a miss.
        state.tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
        state.number = number;
        state.node = static_cast<std::uint16_t>(footer.root_node);
        job_->layout.pack(state, records_.data() + valid_count++ * record_bytes);
        if (tnears != nullptr) {
          tnears[number & (window.chunk_rays() - 1)] = ray.tnear;
        }
      }
      rows.layout.write(miss, rows.row(number));
    }

    lock.lock();
    if (!job_->status.ok()) {
      return job_->status;
    }
    if (job_->rays_pushed == 0) {
      job_->first_push = std::chrono::steady_clock::now();
    }
    window.add(count);
    job_->last_push = std::chrono::steady_clock::now();
    job_->rays_pushed += count;
    for (const std::uint32_t number : invalid) {
      (void)window.complete(number);
    }
    job_->rays_done += invalid.size();
    job_->stats.invalid += invalid.size();
    RayQueue& queue = job_->queues[index_of(root)];
    for (std::uint32_t i = 0; i < valid_count; ++i) {
      std::memcpy(job_->pool->append(queue), records_.data() + i * record_bytes, record_bytes);
    }
    if (valid_count > 0) {
      tracer_->scheduler_.add(root, valid_count, tracer_->state_of(root));
      tracer_->pump_reads();
    }
    lock.unlock();
    tracer_->work_wake_.notify_one();
    rays = rays.subspan(count);
  }
  return {};
}

Status EngineJob::finish() {
  const std::lock_guard lock(tracer_->mutex_);
  job_->finished = true;
  if (job_->window->filling()) {
    job_->window->close_slot();
  }
  job_->changed.notify_all();
  return job_->status;
}

std::optional<HitChunk> EngineJob::next() {
  std::unique_lock lock(tracer_->mutex_);
  ResultWindow& window = *job_->window;
  job_->changed.wait(
      lock, [&] { return !job_->status.ok() || window.deliverable() || (job_->finished && window.drained()); });
  if (!job_->status.ok() || !window.deliverable()) {
    return std::nullopt;
  }
  auto delivery = window.deliver();
  if (!delivery) {
    job_->status = delivery.status();
    end(lock, job_->status);
    return std::nullopt;
  }
  lock.unlock();
  return HitChunk(delivery->index, delivery->first_ray, HitLayout(job_->config.fields), delivery->rows,
                  std::make_unique<ChunkOwner>(tracer_, job_, delivery->slot));
}

Status EngineJob::status() const {
  const std::lock_guard lock(tracer_->mutex_);
  return job_->status;
}

JobProgress EngineJob::progress() const {
  const std::lock_guard lock(tracer_->mutex_);
  return {job_->rays_pushed, job_->rays_done};
}

JobStats EngineJob::stats() const {
  const std::lock_guard lock(tracer_->mutex_);
  JobStats stats = job_->stats;
  stats.rays = job_->rays_pushed;
  stats.pages_read = tracer_->stats_.pages_read;
  stats.bytes_read = tracer_->stats_.bytes_read;
  stats.distinct_pages = tracer_->stats_.distinct_pages;
  stats.distinct_bytes = tracer_->stats_.distinct_bytes;
  stats.evictions = tracer_->cache_->evictions();
  stats.decode_seconds = tracer_->stats_.decode_seconds;
  stats.idle_seconds = tracer_->stats_.idle_seconds;
  stats.most_in_flight = job_->most_in_flight;
  stats.policy = to_string(tracer_->config_.read_order);
  stats.eviction = to_string(tracer_->config_.eviction);
  stats.peak_bytes_by_tag = tracer_->ledger_.peaks();
  stats.result_spill_bytes = job_->window->spilled_bytes();
  stats.trace_seconds = std::max(0.0, std::chrono::duration<double>(job_->last_done - job_->first_push).count());
  stats.peak_rss_bytes = storage::peak_resident_bytes();
  stats.isa = to_string(tracer_->config_.isa);
  stats.kernel = job_->kernel_name;
  stats.io = tracer_->reader_->name();
  stats.io_note = tracer_->file_->io_note();
  return stats;
}

}  // namespace raymill::traversal
