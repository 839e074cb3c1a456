// Messages: what decoding lets through, and values that survive the wire.
#include "server/wire.h"

#include <gtest/gtest.h>

#include "server/limits.h"

namespace raymill::server {
namespace {

template <typename Message>
Status decode_text(const Message& message, std::optional<std::size_t> frame_bytes = std::nullopt) {
  const std::string text = message.SerializeAsString();
  Message out;
  return decode(std::as_bytes(std::span(text)), frame_bytes, out);
}

TEST(Wire, EveryPrefixOfAMessageIsRefusedOrWhole) {
  pb::ClientMessage message;
  message.set_sequence(7);
  message.mutable_start_job()->set_store("city");
  message.mutable_start_job()->set_query(pb::QUERY_ANY);
  message.mutable_start_job()->set_mode(pb::MODE_FAST);
  message.mutable_start_job()->set_fields(1);
  const std::string text = message.SerializeAsString();
  pb::ClientMessage out;
  EXPECT_TRUE(decode(std::as_bytes(std::span(text)), std::nullopt, out).ok());
  for (std::size_t size = 0; size < text.size(); ++size) {
    EXPECT_FALSE(decode(std::as_bytes(std::span(text)).first(size), std::nullopt, out).ok()) << size;
  }
}

TEST(Wire, EveryQueryAndModeComesBack) {
  for (const Query query : {Query::closest, Query::any}) {
    EXPECT_EQ(from_wire(to_wire(query)), query);
  }
  pb::ClientMessage message;
  message.set_sequence(1);
  pb::StartJob& start = *message.mutable_start_job();
  start.set_store("city");
  start.set_query(pb::QUERY_CLOSEST);
  start.set_fields(1);
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    EXPECT_EQ(from_wire(to_wire(mode)), mode);
    start.set_mode(to_wire(mode));
    EXPECT_TRUE(decode_text(message).ok());
    EXPECT_EQ(to_trace_config(start).mode, mode);
  }
  start.set_mode(pb::MODE_UNSPECIFIED);
  EXPECT_FALSE(decode_text(message).ok());
}

TEST(Wire, RowsMustFillTheirFrame) {
  pb::ServerMessage message;
  message.mutable_rows()->set_job("0123456789abcdef");
  message.mutable_rows()->set_rows(10);
  EXPECT_TRUE(decode_text(message, 40).ok());
  EXPECT_FALSE(decode_text(message, 41).ok());
  EXPECT_FALSE(decode_text(message, 0).ok());
  EXPECT_FALSE(decode_text(message).ok());
  message.mutable_rows()->set_rows(0);
  EXPECT_FALSE(decode_text(message, 0).ok());
  message.mutable_rows()->set_rows(~0ull);
  EXPECT_FALSE(decode_text(message, 40).ok());
  message.mutable_job_accepted()->set_chunk_rays(0);
  EXPECT_FALSE(decode_text(message).ok());
  message.mutable_error()->set_code(0);
  EXPECT_FALSE(decode_text(message).ok());
}

TEST(Wire, JobIdsAreSixteenHexadecimalDigits) {
  EXPECT_TRUE(is_job_id("0123456789abcdef"));
  for (const char* id : {"", "0123456789abcde", "0123456789abcdef0", "0123456789ABCDEF", "0123456789abcde/"}) {
    EXPECT_FALSE(is_job_id(id)) << id;
  }
}

TEST(Wire, TextIsMadeFitForProtobuf) {
  EXPECT_EQ(utf8_or_question_marks("caf\xC3\xA9"), "caf\xC3\xA9");
  EXPECT_EQ(utf8_or_question_marks("caf\xE9"), "caf?");
  EXPECT_EQ(utf8_or_question_marks("\xC0\xAF\xED\xA0\x80\xF5"), "??????");
  EXPECT_EQ(utf8_or_question_marks("\xE2\x82"), "??");
  EXPECT_EQ(utf8_or_question_marks("\xF0\x9F\x8C\x8D"), "\xF0\x9F\x8C\x8D");
  std::string lengthy(kMostSentenceBytes - 1, 'x');
  lengthy += "\xC3\xA9";
  EXPECT_EQ(cut_sentence(lengthy).size(), kMostSentenceBytes - 1);
}

TEST(Wire, StatusesOfAPeerKeepTheirCodes) {
  EXPECT_TRUE(status_from_wire(0, "x").ok());
  EXPECT_EQ(status_from_wire(30, "x").code(), ErrorCode::budget_exceeded);
  EXPECT_EQ(status_from_wire(9999, "x").code(), ErrorCode::internal);
  EXPECT_EQ(status_from_wire(65536 + 30, "x").code(), ErrorCode::internal);
}

TEST(Wire, StatsAndDescriptionsSurvive) {
  JobStats stats;
  stats.rays = 1;
  stats.crossings = 9;
  stats.distinct_pages = 6;
  stats.trace_seconds = 1.5;
  stats.io = "pread";
  stats.io_note = "buffered";
  const JobStats back = from_wire(to_wire(stats));
  EXPECT_EQ(back.rays, 1u);
  EXPECT_EQ(back.crossings, 9u);
  EXPECT_EQ(back.distinct_pages, 6u);
  EXPECT_EQ(back.trace_seconds, 1.5);
  EXPECT_EQ(back.io, "pread");
  EXPECT_EQ(back.io_note, "buffered");
  StoreInfo info;
  info.bounds_min = {-1, -2, -3};
  info.bounds_max = {1, 2, 3};
  EXPECT_EQ(from_wire(to_wire(info), "{}").origin, (std::array<double, 3>{}));
  EXPECT_EQ(to_wire(info).origin_size(), 0) << "as before there were any";
  info.origin = {6.4e6, -0.5, 1e-3};
  info.features = {"a", "b"};
  info.least_memory_bytes = 42;
  const StoreInfo again = from_wire(to_wire(info), "{}");
  EXPECT_EQ(again.bounds_min, info.bounds_min);
  EXPECT_EQ(again.bounds_max, info.bounds_max);
  EXPECT_EQ(again.origin, info.origin);
  EXPECT_EQ(again.features, info.features);
  EXPECT_EQ(again.least_memory_bytes, 42u);
  EXPECT_EQ(again.metadata_json, "{}");
}

}  // namespace
}  // namespace raymill::server
