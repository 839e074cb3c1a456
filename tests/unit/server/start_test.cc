// What a server checks before it serves: its address, its socket file, its folders, its memory.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <cstring>
#include <fstream>

#include "server/address.h"
#include "server/endpoint.h"
#include "server/limits.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

Status start_status(const ServeConfig& config) {
  ServerParts parts;
  parts.make_service = [](const EngineConfig&) -> Result<std::unique_ptr<Service>> {
    return std::unique_ptr<Service>(std::make_unique<FakeService>(std::make_shared<FakeState>()));
  };
  return Server::start(config, std::move(parts)).status();
}

TEST(ServerAddress, BeyondLoopbackNeedsKeys) {
  for (const char* address : {"tcp://0.0.0.0:5557", "tcp://*:5557", "tcp://farm01:5557", "tcp://192.168.0.1:1",
                              "tcp://[::]:5557", "tcp://127.evil.org:1"}) {
    const auto checked = check_server_address(address);
    EXPECT_EQ(checked.status().code(), ErrorCode::unsupported) << address;
    EXPECT_NE(checked.status().message().find("loopback"), std::string::npos);
  }
  for (const char* address : {"tcp://127.0.0.1:5557", "tcp://127.0.0.1:0", "tcp://localhost:*", "tcp://[::1]:80"}) {
    EXPECT_TRUE(check_server_address(address).ok()) << address;
  }
  for (const char* address : {"", "/tmp/x", "ipc://", "ipc://*", "ipc://@x", "tcp://127.0.0.1", "tcp://:1",
                              "tcp://127.0.0.1:x", "tcp://127.0.0.1:65536", "inproc://x"}) {
    EXPECT_EQ(check_server_address(address).status().code(), ErrorCode::invalid_argument) << address;
  }
  EXPECT_EQ(check_server_address("ipc://" + std::string(200, 'x')).status().code(), ErrorCode::invalid_argument);
}

TEST(ServerAddress, ALiveSocketIsNotStolen) {
  Harness harness;
  ServeConfig second = harness.config();
  EXPECT_EQ(start_status(second).code(), ErrorCode::busy_retry);
  const auto client = harness.client();
  EXPECT_TRUE(client->stores().ok());
}

TEST(ServerAddress, ASocketOfAnotherProgramIsNotStolen) {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "socket").string();
  const FileDescriptor listener(::socket(AF_UNIX, SOCK_STREAM, 0));
  ::sockaddr_un name{};
  name.sun_family = AF_UNIX;
  std::memcpy(name.sun_path, path.data(), path.size());
  ASSERT_EQ(::bind(listener.get(), reinterpret_cast<const ::sockaddr*>(&name), sizeof name), 0);
  ASSERT_EQ(::listen(listener.get(), 1), 0);
  EXPECT_EQ(Endpoint::claim("ipc://" + path).status().code(), ErrorCode::busy_retry);
}

TEST(ServerAddress, AStaleSocketIsReplacedAndAFileIsNot) {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "socket").string();
  {
    const FileDescriptor listener(::socket(AF_UNIX, SOCK_STREAM, 0));
    ::sockaddr_un name{};
    name.sun_family = AF_UNIX;
    std::memcpy(name.sun_path, path.data(), path.size());
    ASSERT_EQ(::bind(listener.get(), reinterpret_cast<const ::sockaddr*>(&name), sizeof name), 0);
  }
  ASSERT_TRUE(std::filesystem::exists(path));
  {
    const auto claimed = Endpoint::claim("ipc://" + path);
    EXPECT_TRUE(claimed.ok()) << claimed.status().message();
  }
  std::ofstream(path) << "mine";
  EXPECT_EQ(Endpoint::claim("ipc://" + path).status().code(), ErrorCode::invalid_argument);
  EXPECT_TRUE(std::filesystem::is_regular_file(path));
}

TEST(ServerAddress, TheSocketBelongsToItsUser) {
  Harness harness;
  struct stat socket {};
  ASSERT_EQ(::stat(harness.endpoint().substr(6).c_str(), &socket), 0);
  EXPECT_EQ(socket.st_mode & 0777u, 0600u);
  const std::string path = harness.endpoint().substr(6);
  harness.stop();
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_FALSE(std::filesystem::exists(path + ".lock"));
}

TEST(ServerStart, RefusesWhatCannotWork) {
  const TemporaryFolder folder;
  ServeConfig config;
  config.bind = "ipc://" + (folder.path() / "socket").string();
  config.spool_directory = (folder.path() / "spool").string();
  config.stores_directory = (folder.path() / "none").string();
  EXPECT_EQ(start_status(config).code(), ErrorCode::not_found);
  config.stores_directory = folder.path().string();
  config.max_jobs = 0;
  EXPECT_EQ(start_status(config).code(), ErrorCode::invalid_argument);
  config.max_jobs = 100;
  config.memory = mebibytes(16);
  EXPECT_EQ(start_status(config).code(), ErrorCode::budget_exceeded);
  config.max_jobs = 1;
  EXPECT_EQ(start_status(config).code(), ErrorCode::ok);
}

TEST(TransportPlan, ShortensChunksForSmallBudgets) {
  EXPECT_EQ(plan_transport(mebibytes(64), 1, 32).chunk_rays, kLeastChunkRays);
  EXPECT_EQ(plan_transport(gibibytes(4), 1, 32).chunk_rays, kMostChunkRays);
  for (std::uint64_t memory = mebibytes(128); memory <= gibibytes(4); memory *= 2) {
    const TransportPlan plan = plan_transport(memory, 4, 32);
    EXPECT_TRUE(plan.bytes <= memory / 8 || plan.chunk_rays == kLeastChunkRays);
    EXPECT_EQ(plan.bytes, transport_bytes(4, 32, plan.chunk_rays));
  }
}

}  // namespace
}  // namespace raymill::server
