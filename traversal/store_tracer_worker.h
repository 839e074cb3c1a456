// StoreTracer::Worker: what a thread of a StoreTracer owns. WorkLock: how it holds the tracer's mutex. Thread-confined.
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "storage/pages/codec.h"
#include "traversal/lone_page.h"
#include "traversal/store_tracer.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {

/// A lock that knows how long it was waited for and held: what more workers would have to share.
class StoreTracer::WorkLock {
 public:
  explicit WorkLock(std::mutex& mutex) : lock_(mutex, std::defer_lock) { lock(); }

  void lock() {
    const auto begin = Clock::now();
    lock_.lock();
    held_since_ = Clock::now();
    wait_ += held_since_ - begin;
  }
  void unlock() {
    hold_ += Clock::now() - held_since_;
    lock_.unlock();
  }
  /// Runs wait(lock), which gives the mutex back for as long as there is nothing to do.
  template <typename Wait>
  void sleep(Wait&& wait) {
    hold_ += Clock::now() - held_since_;
    wait(lock_);
    held_since_ = Clock::now();
  }
  /// Adds what has gathered since the last call.
  void report(StoreStats& stats) {
    stats.lock_wait_seconds += std::chrono::duration<double>(std::exchange(wait_, {})).count();
    stats.lock_hold_seconds += std::chrono::duration<double>(std::exchange(hold_, {})).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::unique_lock<std::mutex> lock_;
  Clock::time_point held_since_{};
  Clock::duration wait_{}, hold_{};
};

struct StoreTracer::Worker {
  Worker(unsigned index_in, const storage::StoreFile& file, const Config& config)
      : index(index_in), decoder(file.rules(), file.positions(), file.codec()) {
    if (config.adversarial) {
      lone_page.emplace(file.rules());
    }
    if (config.page_trace) {
      page_lane.emplace(config.page_trace, file.page_count());
    }
    rays.reserve(kBatchRays + kBatchSlack);
    parked.reserve(kBatchRays + kBatchSlack);
  }
  const unsigned index;
  storage::PageDecoder decoder;
  std::vector<RayState> rays;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> parked;  // page, index in rays
  std::vector<HitAttributes> attributes;                        // [rays], in a job that asks for some
  // Of a block of fresh rays, once there is one.
  std::vector<Hit> hits;
  std::vector<std::byte> entries;
  std::optional<LonePage> lone_page;
  std::optional<PageTrace::Lane> page_lane;
};

/// A worker's place for hits of rays that have lists; without the mutex.
class StoreTracer::Gathering {
 public:
  Gathering(StoreTracer& tracer, const Worker& worker, TraceJob& job) : tracer_(tracer), job_(job) {
    const std::size_t room = job.crossings.size() / tracer.config_.share.threads;
    buffer_.room = std::span(job.crossings).subspan(worker.index * room, room);
    buffer_.take = [](void* to, std::span<const Crossing> some) {
      auto& self = *static_cast<Gathering*>(to);
      self.tracer_.take_crossings(self.job_, some);
    };
    buffer_.owner = this;
  }
  Gathering(const Gathering&) = delete;
  Gathering& operator=(const Gathering&) = delete;

  /// Null where rays have no lists.
  CrossingBuffer* buffer() { return buffer_.room.empty() ? nullptr : &buffer_; }
  /// What is left of them joins the lists.
  void hand_over() {
    if (buffer() != nullptr) {
      buffer_.empty();
    }
  }

 private:
  StoreTracer& tracer_;
  TraceJob& job_;
  CrossingBuffer buffer_;
};

}  // namespace raymill::traversal
