#include "traversal/engine_job.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "traversal/simd/float_mode.h"

namespace raymill::traversal {
namespace {

// Rays that are made into records between two locks.
constexpr std::size_t kPieceRays = 1024;
static_assert(kPieceRays / RayPool::records_per_chunk(60) + 1 <= RaySpiller::kPushChunks, "no hit yet: 56 B at most");

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

// What becomes of some rays of a push.
struct EngineJob::Piece {
  std::uint32_t first_number = 0;
  std::uint32_t rays = 0;
  std::uint32_t valid = 0;             // with a record each, one after the other
  std::vector<std::uint32_t> invalid;  // numbers
};

// Waits until a ray more may be in flight, has a number and finds room where it waits. Once there are as many as may
// be, it waits until there is place for many: rays are taken in by the many, as pages are read for many at a time.
Status EngineJob::make_room(std::unique_lock<std::mutex>& lock) {
  ResultWindow& window = *job_->window;
  while (job_->status.ok()) {
    if (window.room() == 0) {
      if (window.filling()) {
        window.close_slot();
        job_->changed.notify_all();
      }
      (void)window.begin_slot();
    }
    job_->push_blocked = !job_->place_for_one() || (job_->push_blocked && !job_->place_for_many());
    job_->push_needs_room = !job_->push_blocked && !tracer_->has_room(*job_);
    if (!job_->push_blocked && !job_->push_needs_room) {
      return {};
    }
    tracer_->pump_reads();
    job_->changed.wait(lock);
    job_->push_needs_room = false;
  }
  return job_->status;
}

// Makes records of the rays; without the lock.
void EngineJob::pack(std::span<const Ray> rays, Piece& piece) {
  const storage::StoreFooter& footer = tracer_->file().footer();
  const RecordLayout& layout = job_->waiting->pool().layout();
  records_.resize(rays.size() * layout.most_bytes());
  std::size_t at = 0;
  for (const Ray& ray : rays) {
    const std::uint32_t number = piece.first_number + piece.rays++;
    if (!TraceJob::valid(ray)) {
      piece.invalid.push_back(number);
      continue;
    }
    RayState state;
    state.org = ray.org;
    state.dir = ray.dir;
    state.tnear = ray.tnear;
    // A hit has a finite t; beyond float32 lies a miss.
    state.tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
    state.number = number;
    state.node = static_cast<std::uint16_t>(footer.root_node);
    at += layout.pack(state, records_.data() + at);
    ++piece.valid;
  }
}

// Puts the records into the root page's queue and answers the invalid rays.
Status EngineJob::enqueue(const Piece& piece) {
  const auto now = TraceJob::Clock::now();
  if (job_->rays_pushed == 0) {
    job_->first_push = now;
  }
  job_->last_push = now;
  job_->window->add(piece.rays);
  job_->rays_pushed += piece.rays;
  job_->stats.peak_in_flight = std::max(job_->stats.peak_in_flight, job_->in_flight());
  Hit unanswered;
  unanswered.t = std::numeric_limits<float>::quiet_NaN();
  for (const std::uint32_t number : piece.invalid) {
    RAYMILL_RETURN_IF_ERROR(job_->window->complete(number, unanswered).status());
  }
  job_->rays_done += piece.invalid.size();
  job_->stats.invalid += piece.invalid.size();
  const storage::PageId root = tracer_->root_page();
  const RecordLayout& layout = job_->waiting->pool().layout();
  for (std::size_t i = 0, at = 0; i < piece.valid; ++i) {
    const std::size_t bytes = layout.bytes(records_.data() + at);
    std::memcpy(job_->waiting->append(root, bytes), records_.data() + at, bytes);
    at += bytes;
  }
  if (piece.valid > 0) {
    tracer_->scheduler_.add(root, piece.valid, tracer_->state_of(root));
    tracer_->pump_reads();
  }
  return {};
}

Status EngineJob::push_some(std::span<const Ray> rays) {
  while (!rays.empty()) {
    std::unique_lock lock(tracer_->mutex_);
    if (job_->finished) {
      return {ErrorCode::invalid_argument, "rays were pushed after finish()"};
    }
    RAYMILL_RETURN_IF_ERROR(make_room(lock));
    Piece piece;
    piece.first_number = job_->window->next_number();
    const auto count =
        std::min<std::uint64_t>({rays.size(), job_->window->room(), job_->most_in_flight - job_->in_flight()});
    job_->waiting->promise(RaySpiller::kPushChunks);
    lock.unlock();

    pack(rays.first(count), piece);

    lock.lock();
    job_->waiting->settle(RaySpiller::kPushChunks);
    if (!job_->status.ok()) {
      return job_->status;
    }
    if (Status status = enqueue(piece); !status.ok()) {
      job_->status = status;
      end(lock, status);
      return status;
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
  ResultWindow::Delivery delivery = window.begin_delivery();
  lock.unlock();
  const Status status = window.collect(delivery);
  lock.lock();
  window.end_delivery(delivery);
  if (!status.ok()) {
    window.free_slot(delivery.slot);
    job_->status = job_->status.ok() ? status : job_->status;
    end(lock, status);
    return std::nullopt;
  }
  lock.unlock();
  return HitChunk(delivery.index, delivery.first_ray, HitLayout(job_->config.fields), delivery.rows,
                  std::make_unique<ChunkOwner>(tracer_, job_, delivery.slot));
}

Status EngineJob::status() const {
  const std::lock_guard lock(tracer_->mutex_);
  return job_->status;
}

JobProgress EngineJob::progress() const {
  const std::lock_guard lock(tracer_->mutex_);
  return {job_->rays_pushed, job_->rays_done, tracer_->stats_.bytes_read};
}

JobStats EngineJob::stats() const {
  const std::lock_guard lock(tracer_->mutex_);
  JobStats stats = job_->stats;
  stats.rays = job_->rays_pushed;
  stats.pages_read = tracer_->stats_.pages_read;
  stats.reads = tracer_->reader_->reads();
  stats.stalls = tracer_->stats_.stalls;
  const std::uint64_t begun = tracer_->stats_.pages_read + tracer_->readings_.size();
  stats.mean_read_depth = begun > 0 ? double(tracer_->stats_.depths) / double(begun) : 0.0;
  stats.bytes_read = tracer_->stats_.bytes_read;
  stats.distinct_pages = tracer_->stats_.distinct_pages;
  stats.distinct_bytes = tracer_->stats_.distinct_bytes;
  stats.evictions = tracer_->cache_->evictions();
  stats.expand_seconds = tracer_->stats_.expand_seconds;
  stats.decode_seconds = tracer_->stats_.decode_seconds;
  stats.idle_seconds = tracer_->stats_.idle_seconds;
  stats.most_in_flight = job_->most_in_flight;
  stats.policy = to_string(tracer_->config_.read_order);
  stats.eviction = to_string(tracer_->config_.eviction);
  stats.peak_bytes_by_tag = tracer_->ledger_.peaks();
  stats.result_spill_bytes = job_->window->spilled_bytes();
  stats.ray_spill_bytes = job_->waiting->spilled_bytes();
  stats.trace_seconds = std::max(0.0, std::chrono::duration<double>(job_->last_done - job_->first_push).count());
  stats.peak_rss_bytes = storage::peak_resident_bytes();
  stats.isa = to_string(tracer_->config_.isa);
  stats.kernel = job_->kernel_name;
  stats.io = tracer_->reader_->name();
  stats.io_note = tracer_->file_->io_note();
  return stats;
}

}  // namespace raymill::traversal
