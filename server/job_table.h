// JobTable: every job that the server knows, and who may run.
//
//            add                 admit                    last row           (detached)
//   client ------> queued  --------------------> running ---------> done  ------------> dropped by CancelJob
//                    |      a job place and a       |
//                    |      store slot are free     +------------> failed / cancelled
//                    +------------------------------------------->
// Places go strictly by arrival: a job whose store has no slot yet holds back those behind it, so it cannot starve.
// Attached jobs leave the table when they have ended; detached ones stay until they are dropped, so that whoever waits
// for one learns how it ended.
// Thread-confined to the router thread.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>

#include "server/events.h"
#include "server/job_runner.h"
#include "server/spool.h"
#include "server/store_table.h"

namespace raymill::server {

struct JobRecord {
  JobSpec spec;
  std::string owner;  ///< routing id of the connection that uploads or reads it; empty when none does any more
  pb::JobState state = pb::JOB_STATE_QUEUED;
  std::uint64_t received_chunks = 0;
  std::uint64_t taken_chunks = 0;  ///< by the tracer
  std::uint64_t rays = 0;
  bool started = false;  ///< its store is open: chunks may come
  bool upload_finished = false;
  bool drop_at_end = false;      ///< cancelled: nothing of it is kept
  std::uint64_t total_rows = 0;  ///< once done
  Status end;                    ///< why it failed or was cancelled
  std::unique_ptr<JobRunner> runner;

  [[nodiscard]] bool ended() const { return state >= pb::JOB_STATE_DONE; }
  /// Chunks below this may be sent.
  [[nodiscard]] std::uint64_t chunk_limit() const;
  [[nodiscard]] std::uint64_t rays_done() const { return runner ? runner->rays_done() : total_rows; }
  [[nodiscard]] pb::JobInfo info() const;
};

class JobTable {
 public:
  JobTable(std::size_t max_jobs, StoreTable& stores, const Spool& spool, EventQueue& events);

  /// Queues a job. Errors: busy_retry (queue full, or too many kept results).
  Result<JobRecord*> add(JobSpec spec, std::string owner);
  /// Null: no such job.
  JobRecord* find(const std::string& id);
  [[nodiscard]] const std::map<std::string, JobRecord>& all() const { return jobs_; }
  [[nodiscard]] std::size_t running() const { return running_; }

  /// Starts those whose turn it is.
  void admit();
  /// Ends a queued job at once, a running one soon (RunEnded follows). `why` is what its owner is told.
  void cancel(JobRecord& job, const Status& why);
  /// Takes note of a run that ended; the record is then ended.
  void ended(JobRecord& job, RunEnded&& end);
  /// Forgets an ended job and its rows.
  void erase(const std::string& id);

 private:
  [[nodiscard]] std::string new_id() const;
  bool room_to_keep();
  /// Of masks of geometries: a job's, and those of all jobs that have not ended.
  static std::uint64_t mask_bytes(const JobSpec& spec);
  [[nodiscard]] std::uint64_t mask_bytes() const;

  const std::size_t max_jobs_;
  StoreTable& stores_;
  const Spool& spool_;
  EventQueue& events_;
  std::map<std::string, JobRecord> jobs_;
  std::deque<std::string> queue_;
  std::size_t running_ = 0;
};

/// 16 random hexadecimal digits.
std::string random_id();

}  // namespace raymill::server
