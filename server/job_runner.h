// JobRunner: one running job on the server, from the opening of its store to its last row.
//
//   router --offer()--> chunks (kChunkWindow at most) --> push thread --Job::push--+
//                                                                                  v   engine
//   router <--events--- rows of an attached job <-------- result thread <--Job::next--+
//              |        (kRowsWindow at most unaccepted)       |
//              +------- or the spool file of a detached one <--+
// While the client accepts no rows, the result thread does not call next(): results wait in the engine, which spills
// them, and pushing goes on. Public calls belong to the router thread and do not block, but for the destructor.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/events.h"
#include "server/spool.h"
#include "server/store_table.h"
#include "traversal/service.h"

namespace raymill::server {

struct JobSpec {
  std::string id;
  std::string store;  ///< canonical name
  TraceConfig trace;
  bool detached = false;
  std::uint32_t chunk_rays = 0;  ///< most rows of a message too; of lists: no more bytes than so many rows may have
  std::uint64_t rows_limit = 0;  ///< as in StartJob
};

class JobRunner {
 public:
  /// Starts at once. The caller has reserved the store; the runner releases it before it posts RunEnded.
  JobRunner(JobSpec spec, StoreTable& stores, const Spool& spool, EventQueue& events);
  ~JobRunner();  ///< cancels, and waits for the threads
  JobRunner(const JobRunner&) = delete;
  JobRunner& operator=(const JobRunner&) = delete;

  void offer(Frame rays);
  void finish();
  void accept_rows(std::uint64_t limit);
  void cancel();
  /// Rays that are traced, by the tracer's own count.
  [[nodiscard]] std::uint64_t rays_done() const;

 private:
  void run();
  Status trace(JobStats& stats);
  void push_chunks(Job& job);
  void fail_push(Job& job, const Status& status);
  Status take_results(Job& job);
  Status wait_for_reader();
  Status send_rows(const HitChunk& chunk);
  Status send_lists(const HitChunk& chunk);
  void post(decltype(JobEvent::what) what) { events_.post(JobEvent{spec_.id, std::move(what)}); }

  const JobSpec spec_;
  StoreTable& stores_;
  const Spool& spool_;
  EventQueue& events_;

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Frame> chunks_;
  bool finished_ = false;
  bool cancelled_ = false;
  std::uint64_t rows_limit_;
  Job* job_ = nullptr;           ///< while it may be cancelled
  std::uint64_t rays_done_ = 0;  ///< once it may not
  Status push_status_;           ///< what ended the push thread early

  // Of the result thread:
  std::uint64_t rows_given_ = 0;  ///< of lists: rays
  std::uint64_t messages_sent_ = 0;
  std::thread result_thread_;
};

}  // namespace raymill::server
