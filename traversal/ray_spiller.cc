#include "traversal/ray_spiller.h"

#include <algorithm>
#include <utility>

#include "traversal/store_tracer.h"

namespace raymill::traversal {
namespace {

// Of a timeline.
constexpr unsigned kSpillLane = 1001;
// Sending fewer rays than these is left for when nothing else helps.
constexpr std::uint32_t kLeastSent = 256;
// How often it looks by itself: whether rays still come is a matter of time.
constexpr std::chrono::milliseconds kLookPeriod{5};

}  // namespace

RaySpiller::RaySpiller(StoreTracer& tracer, storage::MappedMemory buffer)
    : tracer_(tracer), buffer_(std::move(buffer)), thread_([this] { run(); }) {
  if (tracer_.config_.timeline) {
    tracer_.config_.timeline->name_lane(kSpillLane, "rays to and from disk");
  }
}

RaySpiller::~RaySpiller() { stop(); }

void RaySpiller::stop() {
  {
    const std::lock_guard lock(tracer_.mutex_);
    stopping_ = true;
  }
  wake_.notify_one();
  if (thread_.joinable()) {
    thread_.join();
  }
}

void RaySpiller::run() {
  std::unique_lock lock(tracer_.mutex_);
  while (!stopping_) {
    if (const auto turn = next_out()) {
      send(*turn, lock);
    } else if (const auto back = next_in()) {
      bring(*back, lock);
    } else if (tracer_.jobs_.empty()) {
      wake_.wait(lock);
    } else {
      wake_.wait_for(lock, kLookPeriod);
    }
  }
}

std::uint64_t RaySpiller::rays_on_disk() const {
  std::uint64_t rays = 0;
  for (const auto& job : tracer_.jobs_) {
    rays += job->waiting->rays_on_disk();
  }
  return rays;
}

// Free chunks of which a job should have no fewer.
std::uint32_t RaySpiller::chunks_needed(const TraceJob& job) const {
  return tracer_.low_water(job) + (job.push_needs_room ? kPushChunks : 0);
}

bool RaySpiller::may_have_work() const {
  return std::any_of(tracer_.jobs_.begin(), tracer_.jobs_.end(), [this](const auto& job) {
    return job->waiting->rays_on_disk() > 0 || job->waiting->free_chunks() < chunks_needed(*job);
  });
}

bool RaySpiller::may_go(storage::PageId page, Pages pages) const {
  return pages == Pages::all || tracer_.cache_->absent(page);
}

bool RaySpiller::any_may_go(const TraceJob& job, std::uint32_t group, Pages pages) const {
  const std::uint32_t group_pages = tracer_.plan_.group_pages;
  const std::uint32_t begin = group * group_pages;
  const std::uint32_t end = std::min(begin + group_pages, tracer_.file_->page_count());
  for (std::uint32_t page = begin; page < end; ++page) {
    if (job.waiting->count(storage::PageId{page}) > 0 && may_go(storage::PageId{page}, pages)) {
      return true;
    }
  }
  return false;
}

// The group with the most rays in memory; the active one only where no other has enough.
std::optional<std::uint32_t> RaySpiller::fullest_group(const TraceJob& job, Pages pages) const {
  const std::uint32_t active = tracer_.turns_->active();
  std::optional<std::uint32_t> fullest;
  std::uint32_t most = 0;
  for (std::uint32_t group = 0; group < job.waiting->group_count(); ++group) {
    const std::uint32_t rays = job.waiting->memory_rays(group);
    if (group != active && rays > most && any_may_go(job, group, pages)) {
      most = rays;
      fullest = group;
    }
  }
  const bool active_may = pages == Pages::all || !wants_room_;
  if (most < kLeastSent && active != GroupTurns::kNone && active_may && job.waiting->memory_rays(active) > most &&
      any_may_go(job, active, pages)) {
    return active;
  }
  return fullest;
}

bool RaySpiller::has_room_for(const Turn& turn) const {
  const WaitingRays& waiting = *turn.job->waiting;
  return waiting.free_chunks() >= tracer_.low_water(*turn.job) + waiting.chunks_for(*waiting.oldest(turn.group));
}

std::optional<RaySpiller::Turn> RaySpiller::extent_of_active() const {
  const std::uint32_t active = tracer_.turns_->active();
  for (const auto& job : tracer_.jobs_) {
    if (active != GroupTurns::kNone && job->status.ok() && job->waiting->oldest(active) != nullptr) {
      return Turn{job, active};
    }
  }
  return std::nullopt;
}

// What goes to disk next: rays of a job whose memory is short, unless pages that are worth reading will free it.
std::optional<RaySpiller::Turn> RaySpiller::next_out() const {
  const bool reads_help = tracer_.scheduler_.wanted_count() > 0 &&
                          (tracer_.cache_->has_unused_frame() || tracer_.scheduler_.most_wanted_rays() >= kServedRays);
  const auto wanted = wants_room_ ? extent_of_active() : std::nullopt;
  for (const auto& job : tracer_.jobs_) {
    const std::uint32_t free_chunks = job->waiting->free_chunks();
    std::uint32_t needed = chunks_needed(*job);
    bool forced = free_chunks < kLeastRoom;
    if (wanted && wanted->job == job) {
      needed += job->waiting->chunks_for(*job->waiting->oldest(wanted->group));
      forced = true;
    }
    if (job->status.ok() && free_chunks < needed && (forced || !reads_help)) {
      // Batches in hand may give back what they were promised.
      const bool stuck = free_chunks < kLeastRoom && job->batches_out == 0;
      for (const Pages pages : {Pages::absent, Pages::all}) {
        const auto group = pages == Pages::absent || stuck ? fullest_group(*job, pages) : std::nullopt;
        if (group) {
          return Turn{job, *group, pages};
        }
      }
    }
  }
  return std::nullopt;
}

// What comes back next: rays of the group whose turn it is.
std::optional<RaySpiller::Turn> RaySpiller::next_in() {
  wants_room_ = false;
  if (rays_on_disk() == 0 || tracer_.more_rays_come()) {
    return std::nullopt;
  }
  tracer_.turns_->look();
  const auto turn = extent_of_active();
  if (!turn || has_room_for(*turn)) {
    return turn;
  }
  wants_room_ = true;
  if (next_out()) {
    wake();
  } else {
    tracer_.turns_->read_everything();
    tracer_.pump_reads();
  }
  return std::nullopt;
}

void RaySpiller::end_transfer(const Turn& turn, const Status& status) {
  if (!status.ok() && turn.job->status.ok()) {
    turn.job->status = status;
    tracer_.remove_job(*turn.job);
  }
  tracer_.unstall();
  tracer_.pump_reads();
  turn.job->changed.notify_all();
}

void RaySpiller::send(const Turn& turn, std::unique_lock<std::mutex>& lock) {
  WaitingRays& waiting = *turn.job->waiting;
  WaitingRays::Parcel parcel =
      waiting.detach(turn.group, [&](storage::PageId page) { return may_go(page, turn.pages); });
  for (const WaitingRays::Part& part : parcel.parts) {
    tracer_.scheduler_.remove(part.page, part.rays.count);
  }
  lock.unlock();
  const auto begin = Timeline::Clock::now();
  const Status status = waiting.store(parcel, buffer());
  if (tracer_.config_.timeline) {
    tracer_.config_.timeline->span(kSpillLane, "rays to disk", begin, "rays", parcel.rays);
  }
  lock.lock();
  waiting.retire(parcel);
  end_transfer(turn, status);
}

void RaySpiller::bring(const Turn& turn, std::unique_lock<std::mutex>& lock) {
  WaitingRays& waiting = *turn.job->waiting;
  const WaitingRays::Extent extent = waiting.begin_fetch(turn.group);
  const std::uint32_t chunks = waiting.chunks_for(extent);
  waiting.promise(chunks);
  lock.unlock();
  const auto begin = Timeline::Clock::now();
  const Status status = waiting.fetch(extent, buffer());
  if (tracer_.config_.timeline) {
    tracer_.config_.timeline->span(kSpillLane, "rays from disk", begin, "rays", extent.rays);
  }
  lock.lock();
  waiting.settle(chunks);
  if (status.ok() && turn.job->status.ok()) {
    waiting.accept(extent, buffer().first(extent.bytes), [&](storage::PageId page, std::uint32_t rays) {
      tracer_.scheduler_.add(page, rays, tracer_.state_of(page));
    });
  }
  end_transfer(turn, status);
}

}  // namespace raymill::traversal
