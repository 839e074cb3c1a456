#include "server/job_table.h"

#include <algorithm>
#include <cassert>
#include <random>
#include <system_error>
#include <utility>

#include "server/limits.h"

namespace raymill::server {

std::string random_id() {
  static_assert(kJobIdBytes == 16, "two digits to a byte of 64 random bits");
  std::random_device random;
  std::string id;
  for (std::size_t i = 0; i < kJobIdBytes; ++i) {
    id.push_back("0123456789abcdef"[random() & 15u]);
  }
  return id;
}

std::uint64_t JobRecord::chunk_limit() const { return started && !ended() ? taken_chunks + kChunkWindow : 0; }

pb::JobInfo JobRecord::info() const {
  pb::JobInfo info;
  info.set_id(spec.id);
  info.set_store(utf8_or_question_marks(spec.store));
  info.set_state(state);
  info.set_query(to_wire(spec.trace.query));
  info.set_mode(to_wire(spec.trace.mode));
  info.set_fields(static_cast<std::uint32_t>(spec.trace.fields));
  info.set_rays(rays);
  info.set_rays_done(rays_done());
  info.set_detached(spec.detached);
  info.set_error_code(static_cast<std::uint32_t>(end.code()));
  info.set_message(cut_sentence(end.message()));
  return info;
}

JobTable::JobTable(std::size_t max_jobs, StoreTable& stores, const Spool& spool, EventQueue& events)
    : max_jobs_(max_jobs), stores_(stores), spool_(spool), events_(events) {}

std::string JobTable::new_id() const {
  std::string id = random_id();
  while (jobs_.contains(id)) {
    id = random_id();
  }
  return id;
}

Result<JobRecord*> JobTable::add(JobSpec spec, std::string owner) {
  if (queue_.size() >= kMostQueuedJobs) {
    return {ErrorCode::busy_retry, std::to_string(kMostQueuedJobs) + " jobs are waiting already; try again later"};
  }
  if (mask_bytes(spec) > 0 && mask_bytes() + mask_bytes(spec) > kMostMaskBytes) {
    return {ErrorCode::busy_retry, "the server holds as many masks of geometries for jobs as it can; try again later"};
  }
  if (spec.detached && !room_to_keep()) {
    return {ErrorCode::busy_retry, "the server keeps " + std::to_string(kMostKeptJobs) +
                                       " submitted jobs already; fetch and cancel some that are done"};
  }
  spec.id = new_id();
  JobRecord& job = jobs_[spec.id];
  queue_.push_back(spec.id);
  job.spec = std::move(spec);
  job.owner = std::move(owner);
  return &job;
}

std::uint64_t JobTable::mask_bytes(const JobSpec& spec) {
  return spec.trace.geometry_masks ? spec.trace.geometry_masks->size() * sizeof(std::uint32_t) : 0;
}

std::uint64_t JobTable::mask_bytes() const {
  std::uint64_t bytes = 0;
  for (const auto& [id, job] : jobs_) {
    bytes += mask_bytes(job.spec);
  }
  return bytes;
}

bool JobTable::room_to_keep() {
  const auto detached = static_cast<std::size_t>(
      std::count_if(jobs_.begin(), jobs_.end(), [](const auto& job) { return job.second.spec.detached; }));
  if (detached < kMostKeptJobs) {
    return true;
  }
  // Those that failed or were cancelled hold no rows, only the news.
  const auto empty = std::find_if(jobs_.begin(), jobs_.end(), [](const auto& job) {
    return job.second.spec.detached && job.second.ended() && job.second.state != pb::JOB_STATE_DONE;
  });
  if (empty == jobs_.end()) {
    return false;
  }
  erase(std::string(empty->first));
  return true;
}

JobRecord* JobTable::find(const std::string& id) {
  const auto found = jobs_.find(id);
  return found == jobs_.end() ? nullptr : &found->second;
}

void JobTable::admit() {
  while (!queue_.empty() && running_ < max_jobs_) {
    JobRecord& job = jobs_.at(queue_.front());
    if (!stores_.reserve(job.spec.store)) {
      return;
    }
    try {
      job.runner = std::make_unique<JobRunner>(job.spec, stores_, spool_, events_);
    } catch (const std::system_error&) {
      // No thread to be had now: the job stays first in the queue.
      stores_.release(job.spec.store);
      return;
    }
    queue_.pop_front();
    ++running_;
    job.state = pb::JOB_STATE_RUNNING;
    if (job.upload_finished) {
      job.runner->finish();
    }
  }
}

void JobTable::cancel(JobRecord& job, const Status& why) {
  if (job.ended()) {
    return;
  }
  if (job.end.ok()) {
    job.end = why;
  }
  if (job.runner) {
    job.runner->cancel();
    return;
  }
  std::erase(queue_, job.spec.id);
  job.spec.trace.geometry_masks.reset();
  job.state = pb::JOB_STATE_CANCELLED;
}

void JobTable::ended(JobRecord& job, RunEnded&& end) {
  assert(job.runner && running_ > 0);
  --running_;
  job.runner.reset();
  job.spec.trace.geometry_masks.reset();
  job.total_rows = end.total_rows;
  if (!job.end.ok()) {
    // Whoever cancelled it said why, and is told so even where the last row was just written.
    job.state = pb::JOB_STATE_CANCELLED;
  } else if (end.status.ok() && end.total_rows != job.rays) {
    job.end = {ErrorCode::internal,
               std::to_string(job.rays) + " rays were answered by " + std::to_string(end.total_rows) + " answers"};
    job.state = pb::JOB_STATE_FAILED;
  } else {
    job.end = std::move(end.status);
    job.state = job.end.ok() ? pb::JOB_STATE_DONE : pb::JOB_STATE_FAILED;
  }
  if (job.spec.detached && job.state != pb::JOB_STATE_DONE) {
    spool_.remove(job.spec.id);
  }
}

void JobTable::erase(const std::string& id) {
  const auto found = jobs_.find(id);
  assert(found != jobs_.end() && found->second.ended());
  if (found->second.spec.detached) {
    spool_.remove(id);
  }
  jobs_.erase(found);
}

}  // namespace raymill::server
