#include "tests/unit/server/harness.h"

#include <cstdlib>
#include <fstream>
#include <utility>

#include "server/limits.h"

namespace raymill::server {

TemporaryFolder::TemporaryFolder() {
  std::string pattern = (std::filesystem::temp_directory_path() / "raymill-test-XXXXXX").string();
  EXPECT_NE(::mkdtemp(pattern.data()), nullptr);
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

void TemporaryFolder::write(const std::string& name, const std::string& text) const {
  std::filesystem::create_directories((path_ / name).parent_path());
  std::ofstream(path_ / name, std::ios::binary) << text;
}

bool eventually(const std::function<bool()>& condition) {
  for (int i = 0; i < 2000; ++i) {
    if (condition()) {
      return true;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return false;
}

Harness::Harness(const std::function<void(ServeConfig&)>& adjust) {
  folder_.write("stores/city.mill", "city");
  folder_.write("stores/town.mill", "town text");
  folder_.write("stores/corrupt.mill", "corrupt");
  folder_.write("stores/failing.mill", "failing");
  config_.stores_directory = (folder_.path() / "stores").string();
  config_.spool_directory = (folder_.path() / "spool").string();
  config_.bind = "ipc://" + (folder_.path() / "socket").string();
  config_.memory = mebibytes(64);
  config_.max_jobs = 4;
  config_.max_stores = 2;
  if (adjust) {
    adjust(config_);
  }
  ServerParts parts;
  parts.make_service = [this](const EngineConfig&) -> Result<std::unique_ptr<Service>> {
    return std::unique_ptr<Service>(std::make_unique<FakeService>(fake_));
  };
  auto server = Server::start(config_, std::move(parts));
  if (!server.ok()) {
    ADD_FAILURE() << server.status().message();
    std::abort();
  }
  server_ = std::move(*server);
  endpoint_ = server_->endpoint();
  thread_ = std::thread([this] { EXPECT_TRUE(server_->run().ok()); });
}

Harness::~Harness() { stop(); }

void Harness::stop() {
  if (server_) {
    server_->stop();
    thread_.join();
    server_.reset();
  }
}

std::unique_ptr<Client> Harness::client(double timeout_seconds) const {
  auto client = Client::connect({.address = endpoint_, .timeout_seconds = timeout_seconds});
  if (!client.ok()) {
    ADD_FAILURE() << client.status().message();
    std::abort();
  }
  return std::move(*client);
}

RawClient::RawClient(const std::string& endpoint) {
  socket_.set(zmq::sockopt::linger, 0);
  socket_.set(zmq::sockopt::rcvtimeo, 2000);
  socket_.connect(endpoint);
}

void RawClient::send(const std::vector<std::string>& parts) {
  for (std::size_t i = 0; i < parts.size(); ++i) {
    socket_.send(zmq::buffer(parts[i]), i + 1 < parts.size() ? zmq::send_flags::sndmore : zmq::send_flags::none);
  }
}

void RawClient::send(const pb::ClientMessage& message, const std::string& frame) {
  std::vector<std::string> parts{message.SerializeAsString()};
  if (!frame.empty()) {
    parts.push_back(frame);
  }
  send(parts);
}

ServerPacket RawClient::receive() {
  while (true) {
    ServerPacket packet;
    Frame part;
    if (!socket_.recv(part)) {
      return packet;
    }
    EXPECT_TRUE(packet.message.ParseFromArray(part.data(), static_cast<int>(part.size())));
    if (part.more()) {
      packet.frame.emplace();
      EXPECT_TRUE(socket_.recv(*packet.frame));
    }
    if (!packet.message.has_pong()) {
      return packet;
    }
  }
}

ServerPacket RawClient::ask(pb::ClientMessage message, const std::string& frame) {
  message.set_sequence(++sequence_);
  send(message, frame);
  while (true) {
    ServerPacket packet = receive();
    if (packet.message.sequence() == sequence_ || packet.message.body_case() == pb::ServerMessage::BODY_NOT_SET) {
      return packet;
    }
  }
}

void RawClient::hello() {
  pb::ClientMessage message;
  message.mutable_hello()->set_protocol_version(kProtocolVersion);
  EXPECT_TRUE(ask(message).message.has_welcome());
}

ErrorCode error_code(const ServerPacket& packet) {
  return packet.message.has_error() ? ErrorCode(packet.message.error().code()) : ErrorCode::ok;
}

Status trace_and_check(Store& store, std::uint64_t first, std::size_t count, std::uint32_t store_bytes) {
  auto job = store.trace({});
  RAYMILL_RETURN_IF_ERROR(job.status());
  std::thread pusher([&] {
    const auto rays = numbered_rays(first, count);
    if ((*job)->push(rays).ok()) {
      (void)(*job)->finish();
    }
  });
  const Status status = read_and_check(**job, first, count, store_bytes);
  pusher.join();
  return status;
}

Status read_and_check(Job& job, std::uint64_t first, std::size_t count, std::uint32_t store_bytes) {
  std::uint64_t row = 0;
  std::uint64_t index = 0;
  while (const auto chunk = job.next()) {
    EXPECT_EQ(chunk->index(), index++);
    EXPECT_EQ(chunk->first_ray(), row);
    for (std::size_t i = 0; i < chunk->size(); ++i, ++row) {
      const Hit got = chunk->hit(i);
      const Hit want = expected_hit(first + row, store_bytes);
      if (got.t != want.t || got.primitive_id != want.primitive_id || got.geometry_id != want.geometry_id) {
        ADD_FAILURE() << "row " << row << " is another one";
        return {ErrorCode::internal, "wrong row"};
      }
    }
  }
  if (job.status().ok()) {
    EXPECT_EQ(row, count);
  }
  return job.status();
}

}  // namespace raymill::server
