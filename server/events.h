// Events: what the job threads and the desk tell the router thread, and the queue that wakes it.
//
//   job threads --+
//   desk thread --+--> EventQueue (mutex, eventfd) --> router thread --> ROUTER socket
//   stop() -------+
// The queue needs no limit of its own: rows are bounded by the job's rows window, takings by its chunk window, desk
// replies by one a connection, ends by one a job. Thread-safe.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/file_descriptor.h"
#include "server/wire.h"

namespace raymill::server {

/// The tracer has taken one more chunk: its frame is free.
struct ChunkTaken {};

/// Rows for the client.
struct RowsReady {
  std::uint64_t index = 0;
  std::uint64_t first_ray = 0;
  std::uint64_t rows = 0;
  std::uint64_t rays = 0;  ///< of lists
  bool goes_on = false;    ///< likewise
  std::uint64_t checksum = 0;
  Frame frame;
};

/// The job's threads are about to end.
struct RunEnded {
  Status status;
  JobStats stats;
  std::uint64_t total_rows = 0;  ///< of lists: rays that are answered
};

/// The job's store is open: its chunks may come.
struct RunStarted {};

struct JobEvent {
  std::string job;
  std::variant<RunStarted, ChunkTaken, RowsReady, RunEnded> what;
};

/// The desk's answer to a connection's request.
struct DeskEvent {
  std::string connection;  ///< routing id
  pb::ServerMessage reply;
  std::optional<Frame> frame;
};

using Event = std::variant<JobEvent, DeskEvent>;

class EventQueue {
 public:
  static Result<std::unique_ptr<EventQueue>> create();
  void post(Event event);
  /// Everything posted since the last call, in order.
  std::vector<Event> take();
  /// Wakes the reader without an event. Async-signal-safe.
  void wake() const;
  /// Readable when there is something to take.
  [[nodiscard]] int descriptor() const { return wake_.get(); }

 private:
  explicit EventQueue(FileDescriptor wake) : wake_(std::move(wake)) {}
  const FileDescriptor wake_;
  std::mutex mutex_;
  std::vector<Event> events_;
};

}  // namespace raymill::server
