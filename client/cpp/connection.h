// Connection: one DEALER socket to a server, and the thread that owns it.
//
//   caller threads --call(), post()--> outgoing --+                       +--> the waiting call()
//                                        (eventfd) +--> thread <--> socket +--> Handlers::message
// The thread pings all the time; when the server stays silent for the timeout, or does not know this connection any
// more, every waiting and later call answers unavailable and Handlers::lost is called once.
// What may be outgoing at once is bounded by the callers (credit). Public calls are thread-safe.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/cpp/client.h"
#include "server/file_descriptor.h"
#include "server/wire.h"

namespace raymill::client {

namespace pb = ::raymill::protocol;
using server::ClientPacket;
using server::Frame;
using server::ServerPacket;

/// Called on the connection's thread: they must not block, nor call() themselves.
struct Handlers {
  std::function<void(ServerPacket&&)> message = [](ServerPacket&&) {};  ///< no call() waits for it
  std::function<void(const Status&)> lost = [](const Status&) {};
};

class Connection {
 public:
  /// Connects and says hello. Errors: unavailable, version_mismatch, invalid_argument, busy_retry.
  static Result<std::unique_ptr<Connection>> open(std::shared_ptr<zmq::context_t> context, const ClientConfig& config,
                                                  Handlers handlers);
  ~Connection();  ///< says goodbye
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// Sends a message and waits for its answer; an Error message becomes the Status.
  Result<ServerPacket> call(pb::ClientMessage message, std::optional<Frame> frame = std::nullopt);
  /// Sends a message whose answer, if any, goes to Handlers::message.
  void post(pb::ClientMessage message, std::optional<Frame> frame = std::nullopt);

 private:
  using TimePoint = std::chrono::steady_clock::time_point;
  struct Waiting {
    std::optional<ServerPacket> answer;
  };

  Connection(std::shared_ptr<zmq::context_t> context, const ClientConfig& config, Handlers handlers,
             server::FileDescriptor wake);
  void wake() const;
  void run();
  void send_outgoing();
  void receive();
  void deliver(ServerPacket&& packet);
  void keep_alive(TimePoint now);
  void lose(const Status& status);

  const std::shared_ptr<zmq::context_t> context_;
  const ClientConfig config_;
  const Handlers handlers_;
  const server::FileDescriptor wake_;

  std::mutex mutex_;
  std::condition_variable answered_;
  std::deque<ClientPacket> outgoing_;
  std::map<std::uint64_t, Waiting> waiting_;
  std::uint64_t last_sequence_ = 0;
  Status lost_;
  bool stopping_ = false;

  // Of the thread alone:
  zmq::socket_t socket_;
  std::chrono::milliseconds ping_interval_;
  std::chrono::milliseconds silent_for_{0};  ///< since an unanswered sign of life was sent
  bool expecting_ = false;                   ///< something was sent that the server must answer
  TimePoint last_ping_;
  TimePoint last_turn_;
  std::thread thread_;
};

}  // namespace raymill::client
