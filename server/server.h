// Server: `raymill serve`. Stores below one directory, traced for many clients over ZeroMQ, within one memory budget.
//
//   auto server = Server::start(config);      // the engine is made, the address is bound
//   (*server)->run();                         // until stop(), which a signal handler may call
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "server/dispatcher.h"
#include "server/store_table.h"
#include "storage/base/ledger.h"
#include "traversal/engine.h"

namespace raymill::server {

struct ServeConfig {
  std::string stores_directory;
  std::string bind = "ipc:///tmp/raymill.sock";  ///< ipc://PATH, or tcp://127.0.0.1:PORT (0: any free port)
  std::uint64_t memory = gibibytes(2);           ///< of the whole process, the transport's share included
  unsigned threads = 0;
  std::string isa;
  std::string io = "auto";
  unsigned max_jobs = 1;          ///< jobs that run at once; others wait in the queue
  unsigned max_stores = 1;        ///< stores open at once
  unsigned max_connections = 32;  ///< each client has one, and one more for each job it runs
  double idle_seconds = 60;       ///< a store without jobs is closed after so long
  double silence_seconds = 30;    ///< a client that is silent for so long is gone, and its job is cancelled
  std::string spool_directory;    ///< rows of submitted jobs; empty: TMPDIR, else /tmp
  std::string spill_directory;    ///< of the engine; empty: TMPDIR, else /tmp
};

/// What the server takes from outside, so that tests can replace it.
struct ServerParts {
  std::function<Result<std::unique_ptr<Service>>(const EngineConfig&)> make_service;
  Clock now = [] { return std::chrono::steady_clock::now(); };
};

struct ServerStats {
  DispatcherStats messages;
  std::uint64_t malformed = 0;  ///< messages of no sender or too many parts
  std::size_t connections = 0;
  std::size_t jobs_known = 0;
  std::size_t jobs_running = 0;
  std::size_t stores_open = 0;
};

/// run() belongs to one thread; stop() and stats() are thread-safe, stop() async-signal-safe too.
class Server {
 public:
  /// With an Engine of its own. Errors: invalid_argument, unsupported (the address needs CURVE), busy_retry (another
  /// server is there), budget_exceeded, not_found (no stores directory), io.
  static Result<std::unique_ptr<Server>> start(const ServeConfig& config);
  static Result<std::unique_ptr<Server>> start(const ServeConfig& config, ServerParts parts);
  ~Server();  ///< run() must have returned
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// Where clients connect: the port that was taken is in it.
  [[nodiscard]] const std::string& endpoint() const;
  /// Serves until stop(); then cancels every job, tells the clients, and returns.
  Status run();
  void stop();
  [[nodiscard]] ServerStats stats() const;

 private:
  class Impl;
  explicit Server(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace raymill::server
