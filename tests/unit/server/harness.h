// Harness: a server with a fake tracer in a folder of its own, a client for it, and a raw socket for what no client
// of ours would send.
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "client/cpp/client.h"
#include "server/server.h"
#include "server/wire.h"
#include "tests/unit/server/fake_service.h"

namespace raymill::server {

/// A folder below the system's temporary one, removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  void write(const std::string& name, const std::string& text) const;

 private:
  std::filesystem::path path_;
};

/// Waits up to ten seconds for `condition`.
bool eventually(const std::function<bool()>& condition);

class Harness {
 public:
  explicit Harness(const std::function<void(ServeConfig&)>& adjust = {});
  ~Harness();
  Harness(const Harness&) = delete;
  Harness& operator=(const Harness&) = delete;

  void stop();
  [[nodiscard]] std::unique_ptr<Client> client(double timeout_seconds = 10) const;
  [[nodiscard]] ServerStats stats() const { return server_->stats(); }
  [[nodiscard]] const std::string& endpoint() const { return endpoint_; }
  [[nodiscard]] FakeState& fake() { return *fake_; }
  [[nodiscard]] const TemporaryFolder& folder() const { return folder_; }
  [[nodiscard]] const ServeConfig& config() const { return config_; }

 private:
  TemporaryFolder folder_;
  std::shared_ptr<FakeState> fake_ = std::make_shared<FakeState>();
  ServeConfig config_;
  std::unique_ptr<Server> server_;
  std::string endpoint_;
  std::thread thread_;
};

/// The bytes of the stores that each harness has: "city.mill" and "town.mill".
constexpr std::uint32_t kCityBytes = 4;
constexpr std::uint32_t kTownBytes = 9;

/// A DEALER that sends any parts.
class RawClient {
 public:
  explicit RawClient(const std::string& endpoint);
  void send(const std::vector<std::string>& parts);
  void send(const pb::ClientMessage& message, const std::string& frame = {});
  /// The next message that is no Pong; an empty one after two seconds.
  ServerPacket receive();
  /// Sends and returns the answer with the message's sequence, or without any.
  ServerPacket ask(pb::ClientMessage message, const std::string& frame = {});
  void hello();

 private:
  zmq::context_t context_{1};
  zmq::socket_t socket_{context_, zmq::socket_type::dealer};
  std::uint64_t sequence_ = 0;
};

ErrorCode error_code(const ServerPacket& packet);

/// Traces numbered rays and checks every row; answers the job's status.
Status trace_and_check(Store& store, std::uint64_t first, std::size_t count, std::uint32_t store_bytes);
/// Reads all rows of a job and checks them.
Status read_and_check(Job& job, std::uint64_t first, std::size_t count, std::uint32_t store_bytes);

}  // namespace raymill::server
