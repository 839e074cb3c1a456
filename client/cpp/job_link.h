// JobLink: a job on the server as this side sees it: chunks out by credit, rows in by credit, and how it ended.
//
//   push() --> chunk being filled --(credit)--> server
//   next() <-- rows received <------(credit)--- server      kRowsWindow messages at most lie here
// A caller that pushes everything before its first next() cannot block itself: rows that are not accepted wait at the
// server, and credit for chunks does not depend on them. push() and finish() may run in one thread while next() runs
// in another, and the others in any.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>

#include "client/cpp/connection.h"
#include "traversal/service.h"

namespace raymill::client {

struct JobRequest {
  std::string store;
  TraceConfig trace;
  bool detached = false;
};

class JobLink {
 public:
  /// Asks the server for the job, on a connection of its own. Errors: unavailable, not_found, busy_retry,
  /// invalid_argument.
  static Result<std::unique_ptr<JobLink>> start(std::shared_ptr<zmq::context_t> context, const ClientConfig& config,
                                                const JobRequest& request);
  JobLink(const JobLink&) = delete;
  JobLink& operator=(const JobLink&) = delete;
  ~JobLink() = default;  ///< the connection's goodbye cancels a job that is not finished

  [[nodiscard]] const std::string& id() const { return id_; }
  [[nodiscard]] std::uint32_t chunk_rays() const { return chunk_rays_; }

  /// Fills chunks and sends those that are full. Waits for credit. Errors: also invalid_argument (what the rays bring
  /// is not what the job was asked for).
  Status push(std::span<const Ray> rays, const RayExtras& extras = {});
  /// The same; the job must have been asked for them (TraceConfig::float64), and then takes both kinds.
  Status push64(std::span<const Ray64> rays, const RayExtras& extras = {});
  /// Sends what is left and says that no more comes.
  Status finish();
  std::optional<HitChunk> next();
  void cancel();
  [[nodiscard]] Status status() const;
  [[nodiscard]] JobProgress progress() const;
  [[nodiscard]] JobStats stats() const;

 private:
  struct ReceivedRows {
    pb::Rows header;
    Frame frame;
  };

  JobLink() = default;
  void on_message(ServerPacket&& packet);
  void end(const Status& status);
  [[nodiscard]] Status check(std::size_t rays, const RayExtras& extras) const;
  template <typename AnyRay>
  Status push_any(std::span<const AnyRay> rays, const RayExtras& extras);
  template <typename AnyRay>
  void fill_chunk(std::span<const AnyRay> rays, const RayExtras& extras);
  Frame take_chunk();
  Status send_chunk();
  Result<HitChunk> chunk_of(ReceivedRows rows);
  /// Whether rows are what the server promised them to be.
  [[nodiscard]] Status check(const ReceivedRows& rows) const;

  std::string id_;
  HitLayout layout_;
  TraceConfig config_;  ///< what was asked for
  bool lists_ = false;
  std::uint32_t chunk_rays_ = 0;

  // Of the pushing thread:
  std::optional<Frame> chunk_;  ///< being filled: places for rays, for primitives, for masks
  std::size_t chunk_fill_ = 0;  ///< rays in it
  std::uint64_t chunks_sent_ = 0;
  bool finished_ = false;
  // Of the reading thread:
  std::uint64_t messages_read_ = 0;
  std::uint64_t rays_read_ = 0;  ///< whose answers are all read

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t chunk_limit_ = 0;
  std::deque<ReceivedRows> rows_;
  std::uint64_t rays_pushed_ = 0;
  std::uint64_t rays_done_ = 0;
  bool ended_ = false;
  Status end_status_;
  JobStats stats_;

  std::unique_ptr<Connection> connection_;  ///< last, so that its thread ends first
};

}  // namespace raymill::client
