// What no client of ours sends: each is answered by a stable code, or counted, and the server goes on.
#include <gtest/gtest.h>

#include <random>

#include "server/limits.h"
#include "storage/base/checksum.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

pb::ClientMessage start_message() {
  pb::ClientMessage message;
  pb::StartJob& start = *message.mutable_start_job();
  start.set_store("city");
  start.set_query(pb::QUERY_CLOSEST);
  start.set_mode(pb::MODE_WATERTIGHT);
  start.set_fields(static_cast<std::uint32_t>(Field::t));
  start.set_rows_limit(kRowsWindow);
  return message;
}

std::string frame_of(const std::vector<Ray>& rays) {
  return {reinterpret_cast<const char*>(rays.data()), rays.size() * sizeof(Ray)};
}

pb::ClientMessage chunk_message(const std::string& job, std::uint64_t index, const std::string& frame) {
  pb::ClientMessage message;
  pb::Chunk& chunk = *message.mutable_chunk();
  chunk.set_job(job);
  chunk.set_index(index);
  chunk.set_rays(frame.size() / sizeof(Ray));
  chunk.set_checksum(storage::checksum(std::as_bytes(std::span(frame))));
  return message;
}

/// A raw client with a running job.
class HostileServer : public testing::Test {
 protected:
  void SetUp() override {
    raw_.hello();
    const ServerPacket accepted = raw_.ask(start_message());
    ASSERT_TRUE(accepted.message.has_job_accepted());
    job_ = accepted.message.job_accepted().job().id();
    ASSERT_TRUE(raw_.receive().message.has_credit());
  }

  /// Another client's work goes as ever.
  void TearDown() override {
    const auto client = harness_.client();
    auto store = client->open("town");
    ASSERT_TRUE(store.ok());
    EXPECT_TRUE(trace_and_check(**store, 0, 2000, kTownBytes).ok());
  }

  Harness harness_;
  RawClient raw_{harness_.endpoint()};
  std::string job_;
  const std::string frame_ = frame_of(numbered_rays(0, 10));
};

TEST_F(HostileServer, DuplicateChunkIsAcknowledgedAndNotTracedTwice) {
  for (int times = 0; times < 3; ++times) {
    const ServerPacket credit = raw_.ask(chunk_message(job_, 0, frame_), frame_);
    ASSERT_TRUE(credit.message.has_credit());
    EXPECT_EQ(credit.message.credit().received(), 1u);
  }
  pb::ClientMessage finish;
  finish.mutable_finish_job()->set_job(job_);
  finish.mutable_finish_job()->set_chunks(1);
  finish.mutable_finish_job()->set_rays(10);
  EXPECT_TRUE(raw_.ask(finish).message.has_job_reply());
  ServerPacket packet = raw_.receive();
  while (!packet.message.has_rows()) {
    packet = raw_.receive();
  }
  EXPECT_EQ(packet.message.rows().rows(), 10u);
  packet = raw_.receive();
  ASSERT_TRUE(packet.message.has_job_ended());
  EXPECT_EQ(packet.message.job_ended().code(), 0u);
  EXPECT_EQ(harness_.fake().rays_traced, 10u);
}

TEST_F(HostileServer, DamagedChunkIsRefusedAndMaySentAgain) {
  std::string damaged = frame_;
  damaged[17] = static_cast<char>(damaged[17] ^ 1);
  EXPECT_EQ(error_code(raw_.ask(chunk_message(job_, 0, frame_), damaged)), ErrorCode::checksum_mismatch);
  EXPECT_TRUE(raw_.ask(chunk_message(job_, 0, frame_), frame_).message.has_credit());
}

TEST_F(HostileServer, ChunksOfWrongShapeAreRefused) {
  // A gap, and an index beyond the credit.
  EXPECT_EQ(error_code(raw_.ask(chunk_message(job_, 1, frame_), frame_)), ErrorCode::invalid_argument);
  EXPECT_EQ(error_code(raw_.ask(chunk_message(job_, ~0ull, frame_), frame_)), ErrorCode::invalid_argument);
  // No whole ray, another count than said, no frame, a frame where none belongs.
  EXPECT_EQ(error_code(raw_.ask(chunk_message(job_, 0, frame_), frame_.substr(1))), ErrorCode::bad_rays);
  auto message = chunk_message(job_, 0, frame_);
  message.mutable_chunk()->set_rays(11);
  EXPECT_EQ(error_code(raw_.ask(message, frame_)), ErrorCode::bad_rays);
  EXPECT_EQ(error_code(raw_.ask(chunk_message(job_, 0, frame_))), ErrorCode::corrupt);
  pb::ClientMessage ping;
  ping.mutable_ping();
  EXPECT_EQ(error_code(raw_.ask(ping, frame_)), ErrorCode::corrupt);
}

TEST_F(HostileServer, ChunksWithoutCreditAreRefused) {
  harness_.fake().hold(true);
  for (std::uint64_t index = 0; index < kChunkWindow; ++index) {
    EXPECT_TRUE(raw_.ask(chunk_message(job_, index, frame_), frame_).message.has_credit());
  }
  EXPECT_EQ(error_code(raw_.ask(chunk_message(job_, kChunkWindow, frame_), frame_)), ErrorCode::busy_retry);
  harness_.fake().hold(false);
}

TEST_F(HostileServer, AFrameBeyondTheLimitEndsTheConnectionOnly) {
  const std::string huge(kMostChunkRays * sizeof(Ray) * 4, 'x');
  raw_.send(chunk_message(job_, 0, huge), huge);
}

TEST_F(HostileServer, FinishMustAgreeOnWhatWasSent) {
  pb::ClientMessage finish;
  finish.mutable_finish_job()->set_job(job_);
  finish.mutable_finish_job()->set_chunks(1);
  finish.mutable_finish_job()->set_rays(10);
  EXPECT_EQ(error_code(raw_.ask(finish)), ErrorCode::invalid_argument);
  finish.mutable_finish_job()->set_chunks(0);
  finish.mutable_finish_job()->set_rays(0);
  EXPECT_TRUE(raw_.ask(finish).message.has_job_reply());
  const ServerPacket late = raw_.ask(chunk_message(job_, 0, frame_), frame_);
  EXPECT_TRUE(error_code(late) == ErrorCode::invalid_argument || error_code(late) == ErrorCode::not_found);
}

TEST_F(HostileServer, JobsOfOthersAreOutOfReach) {
  RawClient other(harness_.endpoint());
  other.hello();
  EXPECT_EQ(error_code(other.ask(chunk_message(job_, 0, frame_), frame_)), ErrorCode::unauthorised);
  pb::ClientMessage message;
  message.mutable_accept_rows()->set_job(job_);
  message.mutable_accept_rows()->set_limit(~0ull);
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::unauthorised);
  message.mutable_finish_job()->set_job(job_);
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::unauthorised);
  message.mutable_cancel_job()->set_job(job_);
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::unauthorised);
  message.mutable_cancel_job()->set_job("0000000000000000");
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::not_found);
  message.mutable_cancel_job()->set_job("../../../../x");
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument);
}

TEST_F(HostileServer, AConnectionHasOneUnfinishedJob) {
  EXPECT_EQ(error_code(raw_.ask(start_message())), ErrorCode::busy_retry);
}

TEST_F(HostileServer, UnknownValuesAreRefused) {
  RawClient other(harness_.endpoint());
  other.hello();
  auto message = start_message();
  message.mutable_start_job()->set_query(static_cast<pb::Query>(77));
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument);
  message = start_message();
  message.mutable_start_job()->set_mode(pb::MODE_UNSPECIFIED);
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument);
  message = start_message();
  message.mutable_start_job()->set_fields(1u << 30);
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument);
  message = start_message();
  message.mutable_start_job()->set_fields(static_cast<std::uint32_t>(Field::t | Field::count));
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument) << "no query answers both";
  message = start_message();
  message.mutable_start_job()->set_rows_limit(0);
  EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument);
  for (const char* name : {"", "/etc/passwd", "../town", "a//b", ".", "x\ny"}) {
    message = start_message();
    message.mutable_start_job()->set_store(name);
    EXPECT_EQ(error_code(other.ask(message)), ErrorCode::invalid_argument) << name;
  }
}

TEST_F(HostileServer, GarbageIsAnsweredOrCounted) {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    std::vector<std::string> parts(1 + random() % 4);
    for (std::string& part : parts) {
      part.resize(random() % 100);
      for (char& c : part) {
        c = static_cast<char>(random());
      }
    }
    raw_.send(parts);
  }
  pb::ClientMessage ping;
  ping.mutable_list_jobs();
  EXPECT_TRUE(raw_.ask(ping).message.has_job_list());
  EXPECT_TRUE(eventually([&] { return harness_.stats().malformed > 0 && harness_.stats().messages.refused > 50; }));
}

TEST_F(HostileServer, ALongProtocolPartIsRefused) {
  raw_.send({std::string(kMostRequestBytes + 1, 'x')});
  EXPECT_EQ(error_code(raw_.receive()), ErrorCode::corrupt);
}

TEST_F(HostileServer, AClientThatNeverReadsIsDropped) {
  RawClient flood(harness_.endpoint());
  flood.hello();
  pb::ClientMessage message;
  message.mutable_list_jobs();
  // More answers than the queues of both sockets take; the flood reads none of them.
  for (int i = 0; i < 40 * kSendQueueMessages; ++i) {
    flood.send(message);
  }
  EXPECT_TRUE(eventually([&] { return harness_.stats().messages.messages > 1000; }));
}

TEST(ServerHello, StrangersAndOtherVersionsAreTurnedAway) {
  Harness harness([](ServeConfig& config) { config.max_connections = 1; });
  RawClient raw(harness.endpoint());
  pb::ClientMessage message;
  message.mutable_list_jobs();
  EXPECT_EQ(error_code(raw.ask(message)), ErrorCode::unavailable);
  message.mutable_hello()->set_protocol_version(99);
  EXPECT_EQ(error_code(raw.ask(message)), ErrorCode::version_mismatch);
  raw.hello();
  const auto client = Client::connect({.address = harness.endpoint(), .timeout_seconds = 2});
  EXPECT_EQ(client.status().code(), ErrorCode::busy_retry);
}

}  // namespace
}  // namespace raymill::server
