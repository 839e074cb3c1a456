#include "storage/import/text_reader.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace raymill::storage {
namespace {

ByteSource source_of(const std::string& text) { return ByteSource::view(std::as_bytes(std::span(text))); }

TEST(TextReader, WordsAndLines) {
  const std::string text = " one  two\tthree\r\n\n four#not\\\n  five \\\r\nsix # seven\neight";
  const ByteSource source = source_of(text);
  TextReader reader(source, 0, {.comments = true, .continuations = true});
  EXPECT_EQ(reader.word(), "one");
  EXPECT_EQ(reader.word(), "two");
  EXPECT_EQ(reader.word(), "three");
  EXPECT_EQ(reader.word(), "");
  EXPECT_EQ(reader.word_of_any_line(), "four#not");
  EXPECT_EQ(reader.word(), "five");
  EXPECT_EQ(reader.word(), "six");
  EXPECT_EQ(reader.word(), "");
  EXPECT_EQ(reader.line(), 5U);
  EXPECT_TRUE(reader.next_line());
  EXPECT_EQ(reader.word(), "eight");
  EXPECT_EQ(reader.word_of_any_line(), "");
  EXPECT_FALSE(reader.next_line());
  EXPECT_TRUE(reader.status().ok());
}

TEST(TextReader, NothingIsLostWhereTheBufferEnds) {
  std::string text;
  std::vector<std::string> words;
  for (int i = 0; text.size() < 3 * ByteWindow::kBytes; ++i) {
    words.push_back("w" + std::to_string(i * 7919));
    text += words.back() + std::string(1 + i % 3, ' ') + (i % 5 == 0 ? "\r\n" : "");
  }
  text.insert(ByteWindow::kBytes / 2, 2 * ByteWindow::kBytes, ' ');
  const ByteSource source = source_of(text);
  TextReader reader(source, 0, {});
  std::string all;
  for (std::string_view word = reader.word_of_any_line(); !word.empty(); word = reader.word_of_any_line()) {
    all += word;
  }
  std::string expected;
  for (const std::string& word : words) {
    expected += word;
  }
  EXPECT_TRUE(all == expected);
}

TEST(TextReader, LongWordsComeInPieces) {
  const std::string text(TextReader::kMostWordBytes + 5, 'x');
  const ByteSource source = source_of(text);
  TextReader reader(source, 0, {});
  EXPECT_EQ(reader.word().size(), TextReader::kMostWordBytes);
  EXPECT_EQ(reader.word(), "xxxxx");
}

TEST(TextReader, TheRestOfALineIsCut) {
  const std::string text = "solid  a name  \r\nsolid abcdefgh\nx";
  const ByteSource source = source_of(text);
  TextReader reader(source, 0, {});
  EXPECT_EQ(reader.word(), "solid");
  EXPECT_EQ(reader.rest_of_line(100), "a name");
  EXPECT_EQ(reader.word_of_any_line(), "solid");
  EXPECT_EQ(reader.rest_of_line(5), "abcde");
  EXPECT_EQ(reader.word_of_any_line(), "x");
}

TEST(TextReader, Numbers) {
  const auto number = [](std::string_view word) {
    float value = -77;
    EXPECT_TRUE(parse_float(word, value)) << word;
    return value;
  };
  EXPECT_EQ(number("1"), 1);
  EXPECT_EQ(number("+1.5e+2"), 150);
  EXPECT_EQ(number("-.25"), -0.25F);
  EXPECT_EQ(number("16777217"), 16777216);
  EXPECT_EQ(number("1e39"), std::numeric_limits<float>::max());
  EXPECT_EQ(number("-1e999"), -std::numeric_limits<float>::max());
  EXPECT_EQ(number("1e-60"), 0);
  EXPECT_EQ(number("1e-999"), 0);
  EXPECT_TRUE(std::isinf(number("inf")));
  EXPECT_TRUE(std::isinf(number("-Infinity")));
  EXPECT_TRUE(std::isnan(number("NaN")));
  EXPECT_TRUE(std::isnan(number("-nan(ind)")));
  float value = 0;
  for (const char* word : {"", "+", "-", "1,5", "0x10", "1e", "1..", "one", "+-1", "--1"}) {
    EXPECT_FALSE(parse_float(word, value)) << word;
  }
  std::int64_t whole = 0;
  EXPECT_TRUE(parse_integer("+12", whole));
  EXPECT_EQ(whole, 12);
  EXPECT_TRUE(parse_integer("-9223372036854775808", whole));
  for (const char* word : {"", "1.0", "9223372036854775808", "1 "}) {
    EXPECT_FALSE(parse_integer(word, whole)) << word;
  }
}

}  // namespace
}  // namespace raymill::storage
