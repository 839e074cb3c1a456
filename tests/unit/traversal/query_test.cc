#include "traversal/query.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/rays.h"

namespace raymill {
namespace {

TEST(Query, NamesAreParsedBack) {
  for (const Query query : {Query::closest, Query::any, Query::count, Query::all, Query::transmittance, Query::spans}) {
    EXPECT_EQ(*parse_query(to_string(query)), query);
  }
  for (const Mode mode : {Mode::watertight, Mode::fast, Mode::exact}) {
    EXPECT_EQ(*parse_mode(to_string(mode)), mode);
  }
  EXPECT_EQ(parse_query("nearest").status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(parse_mode("").status().code(), ErrorCode::invalid_argument);
}

TEST(Fields, EverySetIsParsedBack) {
  for (std::uint32_t bits = 1; bits <= static_cast<std::uint32_t>(Field::all); ++bits) {
    const auto parsed = parse_fields(to_string(Field(bits)));
    ASSERT_TRUE(parsed) << to_string(Field(bits));
    EXPECT_EQ(*parsed, Field(bits));
  }
}

TEST(Fields, ShortNamesStandForSeveral) {
  EXPECT_EQ(*parse_fields("ids"), Field::ids);
  EXPECT_EQ(*parse_fields("all"), Field::all);
  EXPECT_EQ(*parse_fields("u"), Field::uv);
  EXPECT_EQ(*parse_fields("t,v"), Field::t | Field::uv);
  EXPECT_EQ(*parse_fields("t,t"), Field::t);
  EXPECT_EQ(*parse_fields("count"), Field::count);
}

TEST(Fields, UnknownAndEmptyAreRefusedByName) {
  for (const char* text : {"", ",", "t,", "x", "t,,uv", " t"}) {
    const auto parsed = parse_fields(text);
    if (std::string_view(text) == "t,") {
      continue;  // a comma at the end is forgiven
    }
    EXPECT_EQ(parsed.status().code(), ErrorCode::invalid_argument) << "'" << text << "'";
  }
  EXPECT_NE(parse_fields("t,colour").status().message().find("'colour'"), std::string::npos);
}

TEST(HitLayout, RowsHoldTheAskedFieldsInOrder) {
  EXPECT_EQ(HitLayout(Field::t).row_bytes(), 4u);
  EXPECT_EQ(HitLayout(kDefaultClosestFields).row_bytes(), 4u + 8 + 8);
  EXPECT_EQ(HitLayout(Field::all).row_bytes(), 36u);
  EXPECT_EQ(HitLayout(Field::t | Field::primitive_id).numpy_descr(), "[('t', '<f4'), ('primitive_id', '<u4')]");
  EXPECT_EQ(HitLayout(Field::count).row_bytes(), 4u);
  EXPECT_EQ(HitLayout(Field::count).numpy_descr(), "'<u4'");
  EXPECT_EQ(HitLayout(Field::transmittance).row_bytes(), 4u);
  EXPECT_EQ(HitLayout(Field::transmittance).numpy_descr(), "'<f4'");
  EXPECT_EQ(HitLayout(kSpanFields).row_bytes(), 12u);
  EXPECT_EQ(HitLayout(kSpanFields).numpy_descr(), "[('t', '<f4'), ('t_leave', '<f4'), ('geometry_id', '<u4')]");
  EXPECT_EQ(HitLayout(Field::uv | Field::normal).numpy_descr(),
            "[('u', '<f4'), ('v', '<f4'), ('normal', '<f4', (3,))]");
  std::vector<std::byte> row(8);
  Hit hit;
  hit.t = 1.5F;
  hit.primitive_id = 0x01020304;
  HitLayout(Field::t | Field::primitive_id).write(hit, row.data());
  EXPECT_EQ(row[3], std::byte{0x3F});
  EXPECT_EQ(row[4], std::byte{0x04}) << "little-endian";
}

TEST(HitLayout, EverySetGivesBackWhatItHoldsAndDefaultsElse) {
  Hit hit;
  hit.t = 2;
  hit.u = 0.25F;
  hit.v = 0.5F;
  hit.primitive_id = 7;
  hit.geometry_id = 8;
  hit.instance_id = 9;
  hit.normal = {1, 2, 3};
  for (std::uint32_t bits = 1; bits <= static_cast<std::uint32_t>(Field::all); ++bits) {
    const Field fields = Field(bits);
    const HitLayout layout(fields);
    std::vector<std::byte> row(layout.row_bytes());
    layout.write(hit, row.data());
    const Hit back = layout.read(row.data());
    Hit expected;
    expected.t = has(fields, Field::t) ? hit.t : expected.t;
    expected.u = has(fields, Field::uv) ? hit.u : 0;
    expected.v = has(fields, Field::uv) ? hit.v : 0;
    expected.primitive_id = has(fields, Field::primitive_id) ? hit.primitive_id : kNoId;
    expected.geometry_id = has(fields, Field::geometry_id) ? hit.geometry_id : kNoId;
    expected.instance_id = has(fields, Field::instance_id) ? hit.instance_id : kNoId;
    expected.normal = has(fields, Field::normal) ? hit.normal : expected.normal;
    EXPECT_TRUE(tests::same_bits(back, expected)) << to_string(fields);
  }
}

}  // namespace
}  // namespace raymill
