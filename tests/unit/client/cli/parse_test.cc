#include "client/cli/parse.h"

#include <gtest/gtest.h>

namespace raymill::client {
namespace {

TEST(ParseBytes, UnitsArePowersOf1024) {
  EXPECT_EQ(*parse_bytes("123"), 123U);
  EXPECT_EQ(*parse_bytes("64K"), 65536U);
  EXPECT_EQ(*parse_bytes("512M"), 512ULL << 20);
  EXPECT_EQ(*parse_bytes("2g"), 2ULL << 30);
  EXPECT_EQ(*parse_bytes("1TiB"), 1ULL << 40);
  EXPECT_EQ(*parse_bytes("7B"), 7U);
  EXPECT_EQ(*parse_bytes("3MB"), 3ULL << 20);
}

TEST(ParseBytes, RefusesTheRest) {
  for (const char* text :
       {"", "M", "-1", "1.5G", "12Q", "1MiBs", "1 M", "99999999999999999999", "18446744073709551615K", "0x10", "1iB"}) {
    const auto value = parse_bytes(text);
    ASSERT_FALSE(value) << text;
    EXPECT_EQ(value.status().code(), ErrorCode::invalid_argument);
  }
}

TEST(ParseCount, UnitsArePowersOf1000) {
  EXPECT_EQ(*parse_count("20M"), 20000000U);
  EXPECT_EQ(*parse_count("1.5k"), 1500U);
  EXPECT_EQ(*parse_count("0"), 0U);
  EXPECT_EQ(*parse_count("1e3"), 1000U);
  for (const char* text : {"", "-1", "nan", "inf", "1e30", "5x", "5Mi"}) {
    EXPECT_FALSE(parse_count(text)) << text;
  }
}

TEST(ParseExtent, TwoSidesInPixels) {
  const auto extent = parse_extent("1920x1080");
  ASSERT_TRUE(extent);
  EXPECT_EQ(extent->width, 1920U);
  EXPECT_EQ(extent->height, 1080U);
  for (const char* text : {"", "10", "10x", "0x5", "5x0", "70000x5", "5x5x5", "-5x5", "5X5"}) {
    EXPECT_FALSE(parse_extent(text)) << text;
  }
}

TEST(ParseNumbers, CommasBetweenFiniteNumbers) {
  EXPECT_EQ(*parse_numbers("1,-2.5,3e2"), (std::vector<double>{1, -2.5, 300}));
  for (const char* text : {"", "1,", ",1", "1;2", "1,nan", "1,inf", "a"}) {
    EXPECT_FALSE(parse_numbers(text)) << text;
  }
}

}  // namespace
}  // namespace raymill::client
