// StoreTracer, its reading side: which page is read when, and what becomes of a page that comes in.
#include <algorithm>
#include <utility>

#include "storage/pages/codec.h"
#include "traversal/store_tracer.h"
#include "traversal/store_tracer_worker.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {
namespace {

// Rays for each worker that keep it from running dry while a page is read.
constexpr std::uint64_t kEnoughReady = 16 * kBatchRays;

}  // namespace

std::function<std::uint32_t(std::uint32_t)> StoreTracer::encoded_bytes(const storage::StoreFile& store) {
  return [&store](std::uint32_t page) { return store.entry(storage::PageId{page}).encoded_bytes; };
}

void StoreTracer::on_arrival(storage::PageArrival arrival) {
  {
    const std::lock_guard lock(mutex_);
    arrivals_.push_back(std::move(arrival));
  }
  work_wake_.notify_one();
}

// Whether some job gets more rays soon, for which there is or will be room without another ray's end.
bool StoreTracer::more_rays_come() const {
  const auto now = TraceJob::Clock::now();
  return std::any_of(jobs_.begin(), jobs_.end(), [&](const auto& job) {
    return !job->finished && !job->push_blocked && (job->push_needs_room || now - job->last_push < kPushPatience);
  });
}

std::unique_ptr<GroupTurns> StoreTracer::make_turns() const {
  GroupTurns::Config config{file_->page_count(), plan_.group_pages, config_.read_order, encoded_bytes(*file_)};
  GroupTurns::Source source;
  source.rays_on_disk = [this](std::uint32_t group) {
    std::uint64_t rays = 0;
    for (const auto& job : jobs_) {
      rays += job->waiting->disk_rays(group);
    }
    return rays;
  };
  source.wanted_rays = [this](std::uint32_t page) {
    return cache_->absent(storage::PageId{page}) ? scheduler_.demand()[page] : 0;
  };
  return std::make_unique<GroupTurns>(config, std::move(source));
}

// The page to read next. While there are unused frames a page costs nothing but its read. When another page must go for
// it, the more rays it serves the better: as long as more rays come it must serve very many; after that rays run as far
// as they come without reading, and then group after group has its turn.
std::optional<storage::PageId> StoreTracer::page_to_read() {
  if (cache_->has_unused_frame()) {
    return scheduler_.next_wanted();
  }
  if (more_rays_come()) {
    return scheduler_.most_wanted_rays() >= RaySpiller::kServedRays ? scheduler_.next_wanted() : std::nullopt;
  }
  std::uint64_t in_memory = 0;
  for (const auto& job : jobs_) {
    in_memory += job->in_flight() - job->waiting->rays_on_disk();
  }
  const std::uint64_t enough_ready = std::min<std::uint64_t>(in_memory / 4, config_.share.threads * kEnoughReady);
  if (scheduler_.wanted_rays() + enough_ready < in_memory) {
    return std::nullopt;
  }
  if (spiller_->rays_on_disk() == 0 && scheduler_.wanted_count() <= cache_->frame_count() / 2) {
    return scheduler_.next_wanted();  // what is left to read stays beside each other, whoever's turn it is
  }
  const auto page = turns_->next_page();
  return page ? std::optional(storage::PageId{*page}) : std::nullopt;
}

storage::PageDemand StoreTracer::page_demand() const {
  return {scheduler_.demand(), future_demand_ ? future_demand_->counts() : std::span<const FutureDemand::Count>()};
}

void StoreTracer::pump_reads() {
  while (readings_.size() < plan_.read_depth && scheduler_.wanted_count() > 0) {
    const auto page = page_to_read();
    const auto lease = page ? cache_->begin_read(*page, page_demand()) : std::nullopt;
    if (!lease) {
      break;
    }
    scheduler_.reading(*page);
    readings_.push_back({*lease, Timeline::Clock::now()});
    stats_.depths += readings_.size();
    reader_->start(*page);
  }
  if (spiller_->may_have_work()) {
    spiller_->wake();
  }
}

void StoreTracer::handle_arrival(Worker& worker, WorkLock& lock) {
  const storage::PageArrival arrival = std::move(arrivals_.back());
  arrivals_.pop_back();
  const auto of_page = [&](const Reading& r) { return r.lease.page == arrival.page; };
  const Reading reading = *std::find_if(readings_.begin(), readings_.end(), of_page);
  const storage::FrameLease& lease = reading.lease;
  lock.unlock();
  const auto begin = Timeline::Clock::now();
  Status status = arrival.status;
  if (status.ok()) {
    status = file_->check_page(arrival.page, arrival.encoded);
  }
  if (status.ok()) {
    if (const auto size = worker.decoder.decode(arrival.encoded, lease.bytes); !size) {
      status = file_->page_fault(arrival.page, size.status());
    }
  }
  const std::uint64_t encoded_bytes = arrival.encoded.size();
  reader_->release(arrival);
  if (config_.timeline) {
    config_.timeline->read(index_of(arrival.page), reading.begin, begin, encoded_bytes);
    config_.timeline->span(worker.index, "decode", begin, "page", index_of(arrival.page));
  }
  const double decode_seconds = std::chrono::duration<double>(Timeline::Clock::now() - begin).count();
  lock.lock();
  readings_.erase(std::find_if(readings_.begin(), readings_.end(), of_page));
  stats_.decode_seconds += decode_seconds;
  ++stats_.pages_read;
  stats_.bytes_read += encoded_bytes;
  if (!was_read_[index_of(arrival.page)]) {
    was_read_[index_of(arrival.page)] = true;
    ++stats_.distinct_pages;
    stats_.distinct_bytes += encoded_bytes;
  }
  if (config_.page_trace) {
    config_.page_trace->add(PageTrace::Event::read, index_of(arrival.page));
  }
  if (status.ok()) {
    cache_->publish(lease);
  } else {
    cache_->abandon(lease);
    fail_waiting(arrival.page, status);
  }
  scheduler_.arrived(arrival.page, status.ok());
  if (scheduler_.has_ready()) {
    work_wake_.notify_one();
  }
}

}  // namespace raymill::traversal
