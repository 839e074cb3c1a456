#include "client/cli/batch.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

#include "client/cli/interrupt.h"

namespace raymill::client {

namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kWatchPeriod = std::chrono::milliseconds(100);
// Rays of one push where the source has them all: a signal is seen between two pushes.
constexpr std::size_t kSliceRays = 32 << 10;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

Status push(Job& job, std::span<const Ray> rays, const RayExtras* bring) {
  return bring != nullptr ? job.push_with(rays, *bring) : job.push(rays);
}
Status push(Job& job, std::span<const Ray64> rays, const RayExtras* bring) {
  return bring != nullptr ? job.push64(rays, *bring) : job.push64(rays);
}

// Pushes the next rays; false when there are no more. `job_error` is the job's, the returned one the sources'.
template <typename Source>
Result<bool> push_some(Job& job, const Source& source, const ExtrasSource& extras, double& seconds, Status& job_error) {
  const auto begin = Clock::now();
  RAYMILL_ASSIGN_OR_RETURN(const auto rays, source());
  RayExtras bring;
  if (extras && !rays.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(bring, extras(rays.size()));
  }
  seconds += seconds_since(begin);
  job_error = rays.empty() ? job.finish() : push(job, rays, extras ? &bring : nullptr);
  return !rays.empty() && job_error.ok();
}

template <typename Source>
Status push_all(Job& job, const Source& source, const ExtrasSource& extras, double& seconds, Status& job_error) {
  Result<bool> more = true;
  while (more && *more) {
    more = push_some(job, source, extras, seconds, job_error);
  }
  return more.status();
}

// Watches for a signal and reports progress until it is stopped.
class Watcher {
 public:
  Watcher(Job& job, const BatchObserver& observer) : job_(job), observer_(observer), thread_([this] { run(); }) {}
  Watcher(const Watcher&) = delete;
  Watcher& operator=(const Watcher&) = delete;
  ~Watcher() {
    {
      const std::lock_guard lock(mutex_);
      stopped_ = true;
    }
    condition_.notify_one();
    thread_.join();
  }

 private:
  void run() {
    std::unique_lock lock(mutex_);
    while (!condition_.wait_for(lock, kWatchPeriod, [this] { return stopped_; })) {
      if (interrupted()) {
        job_.cancel();
        return;
      }
      if (observer_) {
        observer_(job_.progress());
      }
    }
  }

  Job& job_;
  const BatchObserver& observer_;
  std::mutex mutex_;
  std::condition_variable condition_;
  bool stopped_ = false;
  std::thread thread_;
};

template <typename Source>
Status run_any_batch(Job& job, const Source& source, const HitSink& sink, const BatchObserver& observer,
                     BatchTimes& times, const ExtrasSource& extras) {
  Status source_error, push_error, sink_error;
  double input_seconds = 0;
  {
    const Watcher watcher(job, observer);
    std::thread pusher([&] {
      source_error = push_all(job, source, extras, input_seconds, push_error);
      if (!source_error.ok()) {
        job.cancel();
      }
    });
    while (auto chunk = job.next()) {
      const auto begin = Clock::now();
      sink_error = sink(*chunk);
      times.output_seconds += seconds_since(begin);
      if (!sink_error.ok()) {
        job.cancel();
        break;
      }
    }
    pusher.join();
  }
  times.input_seconds += input_seconds;
  if (interrupted()) {
    job.cancel();
    return interrupted_status();
  }
  for (const Status& status : {source_error, sink_error, job.status(), push_error}) {
    if (!status.ok()) {
      return status;
    }
  }
  if (observer) {
    observer(job.progress());
  }
  return {};
}

}  // namespace

Status run_batch(Job& job, const RaySource& source, const HitSink& sink, const BatchObserver& observer,
                 BatchTimes& times, const ExtrasSource& extras) {
  return run_any_batch(job, source, sink, observer, times, extras);
}

Status run_batch(Job& job, const WideRaySource& source, const HitSink& sink, const BatchObserver& observer,
                 BatchTimes& times, const ExtrasSource& extras) {
  return run_any_batch(job, source, sink, observer, times, extras);
}

RaySource source_of(std::span<const Ray> rays) {
  return [rest = rays]() mutable -> Result<std::span<const Ray>> {
    const auto slice = rest.first(std::min(rest.size(), kSliceRays));
    rest = rest.subspan(slice.size());
    return slice;
  };
}

void RunStats::add(const JobStats& stats) {
  const JobStats before = total_;
  total_ = stats;
  total_.rays += before.rays;
  total_.hits += before.hits;
  total_.invalid += before.invalid;
  total_.crossings += before.crossings;
  total_.nodes_visited += before.nodes_visited;
  total_.triangles_tested += before.triangles_tested;
  total_.rays_expanded += before.rays_expanded;
  total_.pages_entered += before.pages_entered;
  total_.rays_parked += before.rays_parked;
  total_.peak_in_flight = std::max(total_.peak_in_flight, before.peak_in_flight);
  total_.ray_spill_bytes += before.ray_spill_bytes;
  total_.result_spill_bytes += before.result_spill_bytes;
  total_.trace_seconds += before.trace_seconds;
  total_.peak_rss_bytes = std::max(total_.peak_rss_bytes, before.peak_rss_bytes);
}

}  // namespace raymill::client
