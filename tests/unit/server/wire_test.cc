// Messages: what decoding lets through, and values that survive the wire.
#include "server/wire.h"

#include <gtest/gtest.h>

#include "server/limits.h"
#include "server/list_frames.h"

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
  for (const Query query : {Query::closest, Query::any, Query::count, Query::all, Query::transmittance, Query::spans}) {
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
  message.mutable_rows()->set_rays(1);
  EXPECT_FALSE(decode_text(message, 40).ok());
  message.mutable_rows()->set_rows(0);
  EXPECT_TRUE(decode_text(message, 8).ok()) << "a ray without hits";
  message.mutable_rows()->set_rays(~0ull);
  EXPECT_FALSE(decode_text(message, 8).ok());
  message.mutable_job_accepted()->set_chunk_rays(0);
  EXPECT_FALSE(decode_text(message).ok());
  message.mutable_error()->set_code(0);
  EXPECT_FALSE(decode_text(message).ok());
}

TEST(Wire, ARequestComesBackWhole) {
  TraceConfig config{.query = Query::spans, .fields = kSpanFields};
  config.volume = {VolumeMethod::ratio, 0.25, 3, 7, 2, 0.5};
  config.first = 9;
  config.skips = config.masks = true;
  config.mask = 6;
  pb::ClientMessage message;
  message.mutable_start_job()->set_store("city");
  fill(config, *message.mutable_start_job());
  EXPECT_TRUE(decode_text(message).ok());
  const TraceConfig back = to_trace_config(message.start_job());
  EXPECT_EQ(back.query, config.query);
  EXPECT_EQ(back.volume.method, VolumeMethod::ratio);
  EXPECT_EQ(back.volume.step, 0.25);
  EXPECT_EQ(back.volume.density_scale, 3);
  EXPECT_EQ(back.volume.seed, 7u);
  EXPECT_EQ(back.volume.majorant, 2);
  EXPECT_EQ(back.volume.threshold, 0.5);
  EXPECT_EQ(back.first, 9u);
  EXPECT_TRUE(back.skips && back.masks);
  EXPECT_EQ(back.mask, 6u);
  EXPECT_EQ(to_trace_config(pb::StartJob()).mask, kAllMask) << "of a client that knows no masks";

  message.mutable_start_job()->set_geometry_masks(3);
  EXPECT_FALSE(decode_text(message).ok());
  EXPECT_FALSE(decode_text(message, 8).ok());
  EXPECT_TRUE(decode_text(message, 12).ok());
  message.mutable_start_job()->set_geometry_masks(kMostGeometryMasks + 1);
  EXPECT_EQ(decode_text(message, std::size_t(kMostGeometryMasks + 1) * 4).code(), ErrorCode::unsupported);
  message.mutable_start_job()->set_geometry_masks(0);
  message.mutable_start_job()->mutable_volume()->set_method(pb::VOLUME_METHOD_UNSPECIFIED);
  EXPECT_FALSE(decode_text(message).ok());
}

// A chunk of lists with so many rows for each ray; the last one may go on.
HitChunk chunk_of_lists(const std::vector<std::uint32_t>& counts, bool goes_on, std::vector<std::uint32_t>& offsets,
                        std::vector<float>& rows) {
  offsets = {0};
  for (const std::uint32_t count : counts) {
    offsets.push_back(offsets.back() + count);
  }
  rows.clear();
  for (std::uint32_t row = 0; row < offsets.back(); ++row) {
    rows.push_back(static_cast<float>(row));
  }
  HitChunk chunk(0, 0, HitLayout(Field::t), std::as_bytes(std::span(rows)), nullptr);
  chunk.set_offsets(offsets, goes_on);
  return chunk;
}

TEST(Wire, ListsAreCutIntoFramesAndComeBack) {
  const std::vector<std::vector<std::uint32_t>> scenes = {{3},   {0, 0, 0},   {1, 0, 40, 2},
                                                          {500}, {0, 500, 0}, {20, 0, 20, 20, 0, 1, 1, 1, 1, 1}};
  for (const auto& counts : scenes) {
    for (const std::size_t most_bytes : {16UL, 20UL, 100UL, 4000UL}) {
      for (const bool goes_on : {false, true}) {
        std::vector<std::uint32_t> offsets;
        std::vector<float> rows, got;
        const HitChunk chunk = chunk_of_lists(counts, goes_on, offsets, rows);
        std::vector<std::uint32_t> got_counts(counts.size());
        std::size_t ray = 0;
        bool went_on = false;
        ListCutter cutter(chunk, most_bytes);
        while (cutter.next()) {
          EXPECT_EQ(cutter.first(), ray);
          EXPECT_LE(cutter.bytes(), most_bytes);
          std::vector<std::byte> frame(cutter.bytes());
          cutter.write(frame);
          const auto starts = read_offsets(frame, cutter.rays(), cutter.rows(), sizeof(float));
          ASSERT_TRUE(starts.ok());
          for (std::size_t i = 0; i < cutter.rays(); ++i) {
            got_counts[ray + i] += (*starts)[i + 1] - (*starts)[i];
          }
          const auto* values = reinterpret_cast<const float*>(frame.data() + starts->size() * sizeof(std::uint32_t));
          got.insert(got.end(), values, values + cutter.rows());
          went_on = cutter.goes_on();
          ray += cutter.rays() - (went_on ? 1 : 0);
        }
        EXPECT_EQ(got, rows);
        EXPECT_EQ(got_counts, counts);
        EXPECT_EQ(went_on, goes_on);
        EXPECT_EQ(ray, counts.size() - (goes_on ? 1 : 0));
      }
    }
  }
}

TEST(Wire, ListsWhoseOffsetsLieAreRefused) {
  const auto offsets_of = [](std::vector<std::uint32_t> words, std::uint64_t rays, std::uint64_t rows) {
    return read_offsets(std::as_bytes(std::span(words)), rays, rows, 4).status().code();
  };
  EXPECT_EQ(offsets_of({0, 1, 2, 7, 8}, 2, 2), ErrorCode::ok);
  for (const auto& words : std::vector<std::vector<std::uint32_t>>{
           {1, 1, 2, 7, 8}, {0, 3, 2, 7, 8}, {0, 1, 1, 7, 8}, {0, 1, 3, 7, 8}, {0, 1, 2, 7}, {}}) {
    EXPECT_EQ(offsets_of(words, 2, 2), ErrorCode::corrupt);
  }
  EXPECT_EQ(offsets_of({0}, 0, 0), ErrorCode::corrupt);
  EXPECT_EQ(offsets_of({0, 0}, ~0ull, 1), ErrorCode::corrupt);
  EXPECT_EQ(offsets_of({0, 0}, 1, ~0ull), ErrorCode::corrupt);
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
  info.features = {"a", "b"};
  info.least_memory_bytes = 42;
  const StoreInfo again = from_wire(to_wire(info), "{}");
  EXPECT_EQ(again.bounds_min, info.bounds_min);
  EXPECT_EQ(again.bounds_max, info.bounds_max);
  EXPECT_EQ(again.features, info.features);
  EXPECT_EQ(again.least_memory_bytes, 42u);
  EXPECT_EQ(again.metadata_json, "{}");
}

}  // namespace
}  // namespace raymill::server
