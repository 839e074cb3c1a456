// Clients and servers that vanish: the other side frees what it held, and nobody hangs.
#include <gtest/gtest.h>

#include <chrono>
#include <optional>

#include "server/limits.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

TEST(ServerGone, NobodyThereIsSaidWithinTheTimeout) {
  const TemporaryFolder folder;
  const auto start = std::chrono::steady_clock::now();
  const auto client =
      Client::connect({.address = "ipc://" + (folder.path() / "none").string(), .timeout_seconds = 0.3});
  EXPECT_EQ(client.status().code(), ErrorCode::unavailable);
  EXPECT_NE(client.status().message().find("is `raymill serve` running there?"), std::string::npos)
      << client.status().message();
  EXPECT_LT(seconds_since(start), 3);
}

TEST(ServerGone, AddressesThatAreNoneAreRefusedAtOnce) {
  for (const char* address : {"", "city", "ipc://", "tcp://host", "tcp://host:99999", "tcp://*:5555", "udp://a:1"}) {
    EXPECT_EQ(Client::connect({.address = address}).status().code(), ErrorCode::invalid_argument) << address;
  }
}

TEST(ServerGone, AJobEndsWhenTheServerShutsDown) {
  std::optional<Harness> harness(std::in_place);
  const auto client = harness->client();
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok());
  ASSERT_TRUE((*job)->push(numbered_rays(0, 10'000)).ok());
  harness->stop();
  EXPECT_FALSE((*job)->next().has_value());
  EXPECT_EQ((*job)->status().code(), ErrorCode::unavailable) << (*job)->status().message();
}

TEST(ServerGone, AServerThatDiesSilentlyIsNoticed) {
  // A socket that answers nothing more after the job was accepted: what a killed machine looks like.
  const TemporaryFolder folder;
  const std::string address = "ipc://" + (folder.path() / "socket").string();
  zmq::context_t context(1);
  zmq::socket_t socket(context, zmq::socket_type::router);
  socket.set(zmq::sockopt::linger, 0);
  socket.bind(address);
  std::atomic<bool> stop = false;
  std::thread server([&] {
    ReceivedParts received;
    while (!stop) {
      if (!receive_parts(socket, received)) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        continue;
      }
      pb::ClientMessage message;
      (void)message.ParseFromArray(received.parts[1].data(), static_cast<int>(received.parts[1].size()));
      pb::ServerMessage answer;
      answer.set_sequence(message.sequence());
      if (message.has_hello()) {
        answer.mutable_welcome()->set_protocol_version(kProtocolVersion);
      } else if (message.has_open_store()) {
        answer.mutable_store_opened();
      } else if (message.has_start_job()) {
        answer.mutable_job_accepted()->set_chunk_rays(1000);
        pb::JobInfo& job = *answer.mutable_job_accepted()->mutable_job();
        job.set_id("0123456789abcdef");
        job.set_state(pb::JOB_STATE_QUEUED);
        job.set_query(pb::QUERY_CLOSEST);
        job.set_mode(pb::MODE_WATERTIGHT);
        job.set_fields(1);
      } else {
        continue;
      }
      (void)send_packet(socket, received.parts[0].to_string_view(), answer, std::nullopt);
    }
  });
  const auto client = Client::connect({.address = address, .timeout_seconds = 0.4});
  ASSERT_TRUE(client.ok()) << client.status().message();
  auto store = (*client)->open("city");
  ASSERT_TRUE(store.ok()) << store.status().message();
  auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok()) << job.status().message();
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ((*job)->push(numbered_rays(0, 5000)).code(), ErrorCode::unavailable);
  EXPECT_FALSE((*job)->next().has_value());
  EXPECT_LT(seconds_since(start), 5);
  EXPECT_TRUE(eventually([&] { return (*client)->job("0123456789abcdef").status().code() == ErrorCode::unavailable; }));
  stop = true;
  server.join();
}

TEST(ServerGone, ARestartedServerIsNotMistakenForTheOldOne) {
  const TemporaryFolder folder;
  const std::string address = "ipc://" + (folder.path() / "socket").string();
  const auto bind = [&](ServeConfig& config) { config.bind = address; };
  std::optional<Harness> first(std::in_place, bind);
  const auto client = first->client(1);
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  first.reset();
  const Harness second(bind);
  EXPECT_TRUE(eventually([&] { return client->stores().status().code() == ErrorCode::unavailable; }));
  EXPECT_EQ((*store)->trace({}).status().code(), ErrorCode::ok) << "a new job is a new connection";
}

TEST(ClientGone, ADestroyedJobIsCancelledAtOnce) {
  Harness harness;
  const auto client = harness.client();
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  {
    auto job = (*store)->trace({});
    ASSERT_TRUE(job.ok());
    ASSERT_TRUE((*job)->push(numbered_rays(0, 50'000)).ok());
  }
  EXPECT_TRUE(eventually([&] { return harness.fake().live_jobs == 0 && harness.stats().jobs_known == 0; }));
}

TEST(ClientGone, ASilentClientLosesItsJobAndItsMemory) {
  Harness harness([](ServeConfig& config) { config.silence_seconds = 0.3; });
  RawClient raw(harness.endpoint());
  raw.hello();
  pb::ClientMessage message;
  message.mutable_start_job()->set_store("city");
  message.mutable_start_job()->set_query(pb::QUERY_CLOSEST);
  message.mutable_start_job()->set_mode(pb::MODE_WATERTIGHT);
  message.mutable_start_job()->set_fields(1);
  message.mutable_start_job()->set_rows_limit(4);
  const ServerPacket accepted = raw.ask(message);
  ASSERT_TRUE(accepted.message.has_job_accepted());
  EXPECT_TRUE(eventually([&] { return harness.fake().live_jobs == 1; }));
  EXPECT_TRUE(eventually([&] { return harness.fake().live_jobs == 0; }));
  EXPECT_TRUE(eventually([&] { return harness.stats().jobs_known == 0 && harness.stats().connections == 0; }));
  EXPECT_EQ(harness.stats().messages.clients_lost, 1u);
  EXPECT_EQ(error_code(raw.ask(message)), ErrorCode::unavailable);
}

TEST(ClientGone, AQuietButLivingClientKeepsItsJob) {
  Harness harness([](ServeConfig& config) { config.silence_seconds = 0.4; });
  const auto client = harness.client();
  auto store = client->open("city");
  ASSERT_TRUE(store.ok());
  auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok());
  std::this_thread::sleep_for(std::chrono::milliseconds(1200));
  ASSERT_TRUE((*job)->push(numbered_rays(0, 1000)).ok());
  ASSERT_TRUE((*job)->finish().ok());
  EXPECT_TRUE(read_and_check(**job, 0, 1000, kCityBytes).ok());
}

}  // namespace
}  // namespace raymill::server
