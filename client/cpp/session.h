// Session: what a Client and its stores share: the ZeroMQ context and the connection for requests. Thread-safe.
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "client/cpp/connection.h"

namespace raymill::client {

struct Session {
  std::shared_ptr<zmq::context_t> context;
  ClientConfig config;
  std::mutex asking;  ///< the server takes one request that touches its disk at a time from a connection
  std::unique_ptr<Connection> connection;

  /// A call whose answer must have the body `wanted`.
  Result<ServerPacket> ask(pb::ClientMessage message, pb::ServerMessage::BodyCase wanted) {
    RAYMILL_ASSIGN_OR_RETURN(ServerPacket answer, connection->call(std::move(message)));
    if (answer.message.body_case() != wanted) {
      return {ErrorCode::corrupt, config.address + " answered a request with something else"};
    }
    return answer;
  }
  /// The same for requests that touch the server's disk.
  Result<ServerPacket> ask_disk(pb::ClientMessage message, pb::ServerMessage::BodyCase wanted) {
    const std::lock_guard lock(asking);
    return ask(std::move(message), wanted);
  }
};

}  // namespace raymill::client
