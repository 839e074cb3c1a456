// StoreTracer, its rays for the expanded layout: blocks of them, each traced by one worker to the end.
#include <algorithm>
#include <limits>

#include "traversal/store_tracer.h"
#include "traversal/store_tracer_worker.h"
#include "traversal/trace_job.h"

namespace raymill::traversal {

bool StoreTracer::takes_fresh(const TraceJob& job) const {
  return job.fresh != nullptr && (tree_ != nullptr || config_.layout == Layout::expanded);
}

bool StoreTracer::has_fresh() const {
  return tree_ != nullptr &&
         std::any_of(jobs_.begin(), jobs_.end(), [](const auto& job) { return job->fresh && job->fresh->has_ready(); });
}

// A block of the next job, in turn, that has one.
void StoreTracer::run_fresh(Worker& worker, WorkLock& lock) {
  const auto job = next_job([](const TraceJob& it) { return it.fresh && it.fresh->has_ready(); });
  FreshRays::Block* block = job->fresh->next();
  if (job->fresh->has_ready()) {
    work_wake_.notify_one();
  }
  ++job->batches_out;
  lock.unlock();

  const auto begin = Timeline::Clock::now();
  const FreshAnswers answers = trace_fresh(worker, *job, *block);
  if (config_.timeline) {
    config_.timeline->span(worker.index, "fresh rays", begin, "rays", block->count);
  }

  lock.lock();
  --job->batches_out;
  bool chunk_done = false;
  if (job->status.ok()) {
    const Result<bool> settled = settle_fresh(worker, *job, *block, answers);
    chunk_done = settled && *settled;
    job->status = settled.status();
  }
  job->fresh->give_back(block);
  if (!job->status.ok()) {
    remove_job(*job);
  }
  if (chunk_done || push_goes_on(*job) || !job->status.ok()) {
    job->changed.notify_all();
  }
}

// The block's answers, and their entries in the result window where rays have rows.
StoreTracer::FreshAnswers StoreTracer::trace_fresh(Worker& worker, TraceJob& job, const FreshRays::Block& block) {
  Gathering crossings(*this, worker, job);
  worker.hits.assign(block.count, Hit{});
  ExpandedContext context{.tree = tree_->view(),
                          .need_normal = has(job.config.fields, Field::normal),
                          .counters = {},
                          .filter = job.hit_filter(),
                          .crossings = crossings.buffer(),
                          .numbers = block.numbers,
                          .extras = block.extras(),
                          .answers = worker.hits.data()};
  job.expanded_kernel(context, std::span(block.rays).first(block.count), worker.hits);
  crossings.hand_over();
  FreshAnswers answers{.kernel = context.counters};
  const std::size_t entry_bytes = job.window->has_lists() ? 0 : job.window->entry_bytes();
  worker.entries.resize(block.count * entry_bytes);
  for (std::size_t i = 0; i < block.count; ++i) {
    const Hit& hit = worker.hits[i];
    answers.hits += hit.t < std::numeric_limits<float>::infinity() || hit.count > 0 ? 1 : 0;
    answers.counted += job.config.query == Query::count ? hit.count : 0;
    if (entry_bytes > 0) {
      job.window->write_entry(block.numbers[i], hit, &worker.entries[i * entry_bytes]);
    }
  }
  return answers;
}

// True: the chunk is done.
Result<bool> StoreTracer::settle_fresh(const Worker& worker, TraceJob& job, const FreshRays::Block& block,
                                       const FreshAnswers& answers) {
  job.stats.nodes_visited += answers.kernel.nodes_visited;
  job.stats.triangles_tested += answers.kernel.triangles_tested;
  job.stats.rays_expanded += block.count;
  job.stats.hits += answers.hits;
  job.stats.crossings += answers.counted;
  job.rays_done += block.count;
  job.last_done = TraceJob::Clock::now();
  if (job.window->has_lists()) {
    return job.window->complete(block.numbers[0], block.count);
  }
  return job.window->complete_all(block.numbers[0], worker.entries);
}

}  // namespace raymill::traversal
