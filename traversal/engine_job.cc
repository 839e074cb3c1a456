#include "traversal/engine_job.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "traversal/ray_rounding.h"
#include "traversal/simd/float_mode.h"

namespace raymill::traversal {
namespace {

// Rays that are made into records between two locks.
constexpr std::size_t kPieceRays = 1024;
static_assert(kPieceRays / RayPool::records_per_chunk(80) + 1 <= RaySpiller::kPushChunks, "no hit yet: 80 B at most");

Hit unanswered(Query query) {
  Hit hit;
  hit.t = std::numeric_limits<float>::quiet_NaN();
  hit.count = query == Query::count ? kNoCount : 0;
  return hit;
}

}  // namespace

// Gives the slot, or the piece, back when the caller lets go of the chunk; keeps the job's memory until then.
class EngineJob::ChunkOwner final : public HitChunk::Owner {
 public:
  ChunkOwner(std::shared_ptr<StoreTracer> tracer, std::shared_ptr<TraceJob> job, std::uint32_t slot)
      : tracer_(std::move(tracer)), job_(std::move(job)), slot_(slot) {}
  ~ChunkOwner() override {
    {
      const std::lock_guard lock(tracer_->mutex_);
      ResultWindow& window = *job_->window;
      window.has_lists() ? window.free_piece(slot_) : window.free_slot(slot_);
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

// Some rays of a push, which go on together.
struct EngineJob::Slice {
  const Numbered& some;
  std::span<const std::uint32_t> order;  // of all of `some`; empty: as they come
  std::size_t first = 0, count = 0;

  // Calls valid(number, index, ray) for those of `some` that can be traced and invalid(number) for the others.
  template <typename Valid, typename Invalid>
  void each(Valid&& valid, Invalid&& invalid) const {
    for (std::size_t i = first; i < first + count; ++i) {
      const auto index = order.empty() ? static_cast<std::uint32_t>(i) : order[i];
      const std::uint32_t number = some.first_number + index;
      if (const Ray ray = some.rays[index]; TraceJob::valid(ray)) {
        valid(number, index, ray);
      } else {
        invalid(number);
      }
    }
  }
};

EngineJob::Pushed EngineJob::Pushed::part(std::size_t first, std::size_t count) const {
  Pushed some = *this;
  some.rays = rays.empty() ? rays : rays.subspan(first, count);
  some.rays64 = rays64.empty() ? rays64 : rays64.subspan(first, count);
  return some;
}

inline Ray EngineJob::Pushed::operator[](std::size_t index) const {
  if (!rays64.empty()) {
    return round_ray(rays64[index], origin);
  }
  return moves ? moved_ray(rays[index], origin) : rays[index];
}

std::array<float, 3> EngineJob::Pushed::rest(std::size_t index) const {
  if (!rays64.empty()) {
    return rest_of_org(rays64[index].org, origin);
  }
  const auto& org = rays[index].org;
  return rest_of_org({org[0], org[1], org[2]}, origin);
}

EngineJob::Pushed EngineJob::pushed(std::span<const Ray> rays, std::span<const Ray64> rays64) const {
  const storage::Origin origin = job_->config.relative ? storage::Origin() : tracer_->file().header().origin();
  return {rays, rays64, origin.position(), !origin.is_zero()};
}

Status EngineJob::push(std::span<const Ray> rays) { return push_all(pushed(rays, {}), {}); }

Status EngineJob::push_with(std::span<const Ray> rays, const RayExtras& extras) {
  RAYMILL_RETURN_IF_ERROR(check(extras, rays.size()));
  return push_all(pushed(rays, {}), extras);
}

Status EngineJob::push64(std::span<const Ray64> rays, const RayExtras& extras) {
  RAYMILL_RETURN_IF_ERROR(check(extras, rays.size()));
  if (!job_->config.float64 && tracer_->file().has_origins()) {
    return {ErrorCode::invalid_argument,
            "this store keeps parts relative to origins of their own, and the job was not asked for rays of float64 "
            "(TraceConfig::float64)"};
  }
  return push_all(pushed({}, rays), extras);
}

Status EngineJob::check(const RayExtras& extras, std::size_t rays) const {
  const auto check_one = [&](std::size_t count, bool asked, const char* what) -> Status {
    if (count > 0 && !asked) {
      return {ErrorCode::invalid_argument,
              std::string("the job was not asked for rays with ") + what + " (TraceConfig)"};
    }
    if (count > 0 && count != rays) {
      return {ErrorCode::invalid_argument,
              std::to_string(rays) + " rays with " + std::to_string(count) + " " + what + "; each ray takes one"};
    }
    return {};
  };
  RAYMILL_RETURN_IF_ERROR(check_one(extras.skipped.size(), job_->config.skips, "primitives to skip"));
  return check_one(extras.masks.size(), job_->config.masks, "masks");
}

Status EngineJob::push_all(const Pushed& rays, const RayExtras& extras) {
  const IeeeScope ieee;
  for (std::size_t at = 0; at < rays.size();) {
    RAYMILL_ASSIGN_OR_RETURN(Numbered some, take_in(rays.part(at, rays.size() - at)));
    some.extras.skipped = extras.skipped.subspan(extras.skipped.empty() ? 0 : at);
    some.extras.masks = extras.masks.subspan(extras.masks.empty() ? 0 : at);
    // Those of float64 come as they are; where they lie in the world orders the others as well as where they are taken.
    const bool sorted = some.rays.rays64.empty() && tracer_->sorts(some.rays.rays);
    const auto order = sorted ? order_.sort(some.rays.rays) : std::span<const std::uint32_t>();
    for (std::size_t first = 0; first < some.rays.size(); first += kPieceRays) {
      RAYMILL_RETURN_IF_ERROR(push_slice({some, order, first, std::min(kPieceRays, some.rays.size() - first)}));
    }
    at += some.rays.size();
  }
  return {};
}

// Waits until a ray more may be in flight and has a number, and gives as many as may be their numbers. Once there are
// as many as may be, it waits until there is place for many: rays are taken in by the many, as pages are read for many.
Result<EngineJob::Numbered> EngineJob::take_in(const Pushed& rays) {
  std::unique_lock lock(tracer_->mutex_);
  if (job_->finished) {
    return {ErrorCode::invalid_argument, "rays were pushed after finish()"};
  }
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
    if (!job_->push_blocked) {
      const auto count =
          std::min<std::uint64_t>({rays.size(), window.room(), job_->most_in_flight - job_->in_flight(), kSortedRays});
      if (job_->rays_pushed == 0) {
        job_->first_push = TraceJob::Clock::now();
      }
      const Numbered taken{rays.part(0, count), {}, window.next_number()};
      window.add(static_cast<std::uint32_t>(count));
      return taken;
    }
    tracer_->pump_reads();
    job_->changed.wait(lock);
  }
  return job_->status;
}

bool EngineJob::has_room() const {
  return tracer_->takes_fresh(*job_) ? job_->fresh->has_room() : tracer_->has_room(*job_);
}

// Waits until rays find room where they wait.
Status EngineJob::make_room(std::unique_lock<std::mutex>& lock) {
  while (job_->status.ok()) {
    job_->push_needs_room = !has_room();
    if (!job_->push_needs_room) {
      return {};
    }
    tracer_->pump_reads();
    job_->changed.wait(lock);
    job_->push_needs_room = false;
  }
  return job_->status;
}

Status EngineJob::push_slice(const Slice& slice) {
  invalid_.clear();
  std::unique_lock lock(tracer_->mutex_);
  RAYMILL_RETURN_IF_ERROR(make_room(lock));
  const Status status = tracer_->takes_fresh(*job_) ? push_fresh(slice, lock) : push_records(slice, lock);
  if (!status.ok()) {
    end(lock, status);
    return status;
  }
  lock.unlock();
  tracer_->work_wake_.notify_one();
  return {};
}

// Rays for the expanded layout, as they are.
Status EngineJob::push_fresh(const Slice& slice, std::unique_lock<std::mutex>& lock) {
  static_assert(kPieceRays <= FreshRays::kBlockRays);
  FreshRays::Block* block = job_->fresh->take();
  lock.unlock();
  slice.each(
      [&](std::uint32_t number, std::uint32_t index, const Ray& ray) {
        block->numbers[block->count] = number;
        block->rays[block->count] = ray;
        if (block->skipped != nullptr) {
          block->skipped[block->count] = slice.some.skipped(index);
        }
        if (block->masks != nullptr) {
          block->masks[block->count] = slice.some.mask(index);
        }
        ++block->count;
      },
      [this](std::uint32_t number) { invalid_.push_back(number); });
  lock.lock();
  Status status = account(slice.count);
  if (status.ok() && block->count > 0) {
    job_->fresh->put(block);
  } else {
    job_->fresh->give_back(block);
  }
  return status;
}

// Rays that go through pages, as records in the root page's queue.
Status EngineJob::push_records(const Slice& slice, std::unique_lock<std::mutex>& lock) {
  job_->waiting->promise(RaySpiller::kPushChunks);
  lock.unlock();
  const std::uint32_t valid = pack(slice);
  lock.lock();
  job_->waiting->settle(RaySpiller::kPushChunks);
  RAYMILL_RETURN_IF_ERROR(account(slice.count));
  if (valid > 0) {
    enqueue(valid);
  }
  return {};
}

// Makes records of the rays; without the lock. Returns how many.
std::uint32_t EngineJob::pack(const Slice& slice) {
  const storage::StoreFooter& footer = tracer_->file().footer();
  const RecordLayout& layout = job_->waiting->pool().layout();
  records_.resize(slice.count * layout.most_bytes());
  const bool keeps_rest = job_->config.float64 && tracer_->file().has_origins();
  std::size_t at = 0;
  std::uint32_t valid = 0;
  slice.each(
      [&](std::uint32_t number, std::uint32_t index, const Ray& ray) {
        RayState state;
        state.org = ray.org;
        state.dir = ray.dir;
        state.tnear = ray.tnear;
        // A hit has a finite t; beyond float32 lies a miss.
        state.tfar = std::min(ray.tfar, std::numeric_limits<float>::max());
        if (keeps_rest) {
          state.org_rest = slice.some.rays.rest(index);
        }
        state.number = number;
        state.skipped = slice.some.skipped(index);
        state.mask = slice.some.mask(index);
        state.node = static_cast<std::uint16_t>(footer.root_node);
        if (is_of_fog(job_->config.query)) {
          begin_volumes(job_->config.query, job_->config.volume, tracer_->volumes_, state);
        }
        at += layout.pack(state, records_.data() + at);
        ++valid;
      },
      [this](std::uint32_t number) { invalid_.push_back(number); });
  return valid;
}

// Counts rays that were pushed and answers the invalid ones among them.
Status EngineJob::account(std::size_t rays) {
  RAYMILL_RETURN_IF_ERROR(job_->status);
  job_->last_push = TraceJob::Clock::now();
  job_->rays_pushed += rays;
  job_->stats.peak_in_flight = std::max(job_->stats.peak_in_flight, job_->in_flight());
  for (const std::uint32_t number : invalid_) {
    if (job_->window->has_lists()) {
      job_->window->complete(number, 1);
      continue;
    }
    if (const auto done = job_->window->complete(number, unanswered(job_->config.query)); !done) {
      job_->status = done.status();
      return job_->status;
    }
  }
  job_->rays_done += invalid_.size();
  job_->stats.invalid += invalid_.size();
  return {};
}

// Puts so many records into the root page's queue.
void EngineJob::enqueue(std::uint32_t count) {
  const storage::PageId root = job_->start_page;
  const RecordLayout& layout = job_->waiting->pool().layout();
  for (std::size_t i = 0, at = 0; i < count; ++i) {
    const std::size_t bytes = layout.bytes(records_.data() + at);
    std::memcpy(job_->waiting->append(root, bytes), records_.data() + at, bytes);
    at += bytes;
  }
  tracer_->scheduler_.add(root, count, tracer_->state_of(root));
  tracer_->pump_reads();
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
  if (window.has_lists()) {
    return next_piece(lock);
  }
  ResultWindow::Delivery delivery = window.begin_delivery();
  lock.unlock();
  const Status status = window.collect(delivery);
  lock.lock();
  window.end_delivery(delivery);
  if (!status.ok()) {
    window.free_slot(delivery.slot);
    fail(lock, status);
    return std::nullopt;
  }
  lock.unlock();
  return HitChunk(delivery.index, delivery.first_ray, HitLayout(job_->config.fields), delivery.rows,
                  std::make_unique<ChunkOwner>(tracer_, job_, delivery.slot));
}

void EngineJob::fail(std::unique_lock<std::mutex>& lock, const Status& status) {
  job_->status = job_->status.ok() ? status : job_->status;
  end(lock, status);
}

// The next rows of lists of hits. What a chunk has in memory is sorted, or gone to disk, before its first piece comes:
// how long a caller takes with a piece is no worker's business.
std::optional<HitChunk> EngineJob::next_piece(std::unique_lock<std::mutex>& lock) {
  ResultWindow& window = *job_->window;
  Status status;
  while (status.ok() && window.begin_blocks()) {
    lock.unlock();
    status = window.sort_blocks();
    lock.lock();
    window.end_blocks();
  }
  HitLists::Piece piece = window.begin_piece();
  if (status.ok()) {
    lock.unlock();
    status = window.fill_piece(piece);
    lock.lock();
  }
  if (!status.ok()) {
    window.free_piece(piece.number);
    fail(lock, status);
    return std::nullopt;
  }
  const auto [index, first_ray] = window.end_piece(piece);
  lock.unlock();
  job_->changed.notify_all();  // push() may begin a chunk
  HitChunk chunk(index, first_ray, HitLayout(job_->config.fields), piece.rows,
                 std::make_unique<ChunkOwner>(tracer_, job_, piece.number));
  chunk.set_offsets(piece.offsets, piece.goes_on);
  return chunk;
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
  stats.lock_wait_seconds = tracer_->stats_.lock_wait_seconds;
  stats.lock_hold_seconds = tracer_->stats_.lock_hold_seconds;
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
