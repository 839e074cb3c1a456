// Running one batch of rays through a Job, embedded or remote alike.
//
//   source --(pusher thread)--> Job --(caller's thread)--> sink        watcher thread: progress, signals
//
// Nothing is held here but what the source holds: the job gives credit to the pusher and keeps the order for the sink.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::client {

/// The next rays, which stay valid until the next call; an empty span at the end. Called from one thread.
using RaySource = std::function<Result<std::span<const Ray>>()>;
using WideRaySource = std::function<Result<std::span<const Ray64>>()>;
/// What the rays bring that the source gave last, so many; it stays valid as long. None: they bring nothing.
using ExtrasSource = std::function<Result<RayExtras>(std::size_t)>;
/// Takes the next rows, in the rays' order. Called from the thread of run_batch().
using HitSink = std::function<Status(const HitChunk&)>;
/// Called a few times a second while the batch runs, and once at its end; never from two threads at once.
using BatchObserver = std::function<void(const JobProgress&)>;

struct BatchTimes {
  double input_seconds = 0;   ///< in the source
  double output_seconds = 0;  ///< in the sink
};

/// Returns when every ray is answered, or with the first error: the source's, the sink's, the job's, or interrupted
/// when a signal came. After an error the job is cancelled.
Status run_batch(Job& job, const RaySource& source, const HitSink& sink, const BatchObserver& observer,
                 BatchTimes& times, const ExtrasSource& extras = {});
/// The same for rays of float64 (Job::push64).
Status run_batch(Job& job, const WideRaySource& source, const HitSink& sink, const BatchObserver& observer,
                 BatchTimes& times, const ExtrasSource& extras = {});

/// A source of rays that are all in memory already.
RaySource source_of(std::span<const Ray> rays);

/// Figures of several batches of one store: sums, and the store's own counters as they stand last.
class RunStats {
 public:
  void add(const JobStats& stats);
  [[nodiscard]] const JobStats& total() const { return total_; }

 private:
  JobStats total_;
};

}  // namespace raymill::client
