// Client: a Raymill server, with the same calls as the embedded Engine, and jobs that outlive the connection. Public.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "traversal/service.h"

namespace raymill {

struct ClientConfig {
  std::string address = "ipc:///tmp/raymill.sock";  ///< a ZeroMQ endpoint: ipc://PATH or tcp://HOST:PORT
  double timeout_seconds = 10;                      ///< silence after which the server counts as gone (unavailable)
};

enum class JobState : std::uint8_t { queued, running, done, failed, cancelled };
std::string_view to_string(JobState state);

/// A job as the server lists it.
struct JobInfo {
  std::string id;
  std::string store;
  JobState state = JobState::queued;
  Query query = Query::closest;
  Mode mode = Mode::watertight;
  Field fields = Field::none;
  std::uint64_t rays = 0;  ///< received so far, or all when known
  std::uint64_t rays_done = 0;
  bool detached = false;  ///< submitted: results are kept on the server until fetched or cancelled
  std::string message;    ///< why it failed
};

/// Thread-safe: requests share one connection, each job has one of its own.
class Client final : public Service {
 public:
  /// Says hello and checks the protocol version. Errors: unavailable, version_mismatch, invalid_argument (address).
  static Result<std::unique_ptr<Client>> connect(const ClientConfig& config);
  ~Client() override;

  Result<std::shared_ptr<Store>> open(const std::string& name) override;

  /// Uploads a batch as a job that goes on without this client. `rays` fills the span it is given and returns how
  /// many it wrote, 0 at the end. Returns the job's id.
  Result<std::string> submit(const std::string& store, const TraceConfig& config,
                             const std::function<Result<std::size_t>(std::span<Ray>)>& rays);
  /// The same for rays of float64; asks for TraceConfig::float64.
  Result<std::string> submit64(const std::string& store, const TraceConfig& config,
                               const std::function<Result<std::size_t>(std::span<Ray64>)>& rays);
  Result<JobInfo> job(const std::string& id);
  Result<std::vector<JobInfo>> jobs();
  /// Returns when the job is done, failed or cancelled, or after `timeout_seconds` (<= 0: never) with busy_retry.
  Result<JobInfo> wait(const std::string& id, double timeout_seconds);
  /// Hands the rows of a finished job to `sink` in order. Errors: busy_retry (not done yet), not_found, cancelled.
  Status fetch(const std::string& id, const std::function<Status(const HitLayout&, std::uint64_t total_rays)>& begin,
               const std::function<Status(std::span<const std::byte>)>& rows);
  /// Stops a job, or drops the kept results of a finished one.
  Status cancel(const std::string& id);
  /// What the server holds: its stores' names.
  Result<std::vector<std::string>> stores();

 private:
  class Impl;
  explicit Client(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

}  // namespace raymill
