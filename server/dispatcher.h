// Dispatcher: what the server answers to each message. It knows connections and jobs, but no socket.
//
// Nothing that a client sends may stop the server: every refusal is an Error message, and what cannot even be
// answered is counted. Thread-confined to the router thread; it never blocks on a disk or a tracer.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/desk.h"
#include "server/job_table.h"
#include "server/wire.h"

namespace raymill::server {

struct DispatcherConfig {
  std::size_t max_connections = 32;
  std::uint32_t chunk_rays = 0;               ///< of the transport plan
  std::chrono::milliseconds silence{30'000};  ///< after which a client counts as gone
  std::uint64_t instance = 0;
};

/// Hands a message to the transport. False: the client is gone, or reads so slowly that it counts as gone.
using Send = std::function<bool(const std::string& connection, const pb::ServerMessage&, std::optional<Frame>)>;

struct DispatcherStats {
  std::uint64_t messages = 0;
  std::uint64_t refused = 0;            ///< answered by an Error
  std::uint64_t clients_lost = 0;       ///< silent for too long, or left without a goodbye
  std::uint64_t chunks_duplicated = 0;  ///< came again, were acknowledged and not traced
};

class Dispatcher {
 public:
  Dispatcher(DispatcherConfig config, JobTable& jobs, Desk& desk, Send send, Clock now);

  /// Answers one message. `bytes` is its Protocol Buffers part.
  void receive(const std::string& connection, std::span<const std::byte> bytes, std::optional<Frame> frame);
  /// Refuses a message that has the wrong number of parts.
  void refuse(const std::string& connection, const Status& status);
  void handle(Event&& event);
  /// Drops clients that are gone and starts jobs whose turn it is. To be called after each batch of the two above.
  void tick();
  /// Cancels every job; from now on no new one is taken.
  void shut_down();
  [[nodiscard]] std::size_t connections() const { return connections_.size(); }
  [[nodiscard]] const DispatcherStats& stats() const { return stats_; }

 private:
  struct Connection {
    TimePoint last_heard;
    std::string job;         ///< its unfinished job, or empty
    bool desk_busy = false;  ///< the desk has a request of it
  };

  // A request on its way through: who sent it and what its answer must repeat.
  struct Request {
    const std::string& id;
    Connection& connection;
    std::uint64_t sequence;
  };

  void hello(const std::string& id, const pb::ClientMessage& message);
  void dispatch(const Request& request, const pb::ClientMessage& message, std::optional<Frame> frame);
  // In job_requests.cc:
  void start_job(const Request& request, const pb::StartJob& start, const std::optional<Frame>& masks);
  [[nodiscard]] Status may_start(const Request& request, const pb::StartJob& start) const;
  void take_chunk(const Request& request, const pb::Chunk& chunk, Frame frame);
  void finish_job(const Request& request, const pb::FinishJob& finish);
  void accept_rows(const Request& request, const pb::AcceptRows& accept);
  void cancel_job(const Request& request, const std::string& id);
  void get_job(const Request& request, const std::string& id);
  void list_jobs(const Request& request);
  void fetch_rows(const Request& request, const pb::FetchRows& fetch);
  void handle_job(JobEvent&& event);
  JobRecord* own_job(const Request& request, const std::string& id);
  void close_job(JobRecord& job, const JobStats& stats);

  void ask_desk(const Request& request, decltype(DeskTask::what) what);
  void open_store(const Request& request, const std::string& name, bool describe);
  void reply(const std::string& id, std::uint64_t sequence, pb::ServerMessage& message,
             std::optional<Frame> frame = std::nullopt);
  void reply_error(const std::string& id, std::uint64_t sequence, const Status& status, const std::string& job = {});
  void send_credit(const JobRecord& job, std::uint64_t sequence);
  void drop(const std::string& id, const char* why);

  const DispatcherConfig config_;
  JobTable& jobs_;
  Desk& desk_;
  const Send send_;
  const Clock now_;
  std::map<std::string, Connection> connections_;
  std::vector<std::string> lost_;  ///< found gone while something was sent to them; dropped by tick()
  bool shutting_down_ = false;
  DispatcherStats stats_;
};

}  // namespace raymill::server
