// TextReader: a text file as words and lines. A line ends with a line feed, a carriage return, or both; words are what
// blanks part. Thread-confined.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "storage/import/byte_window.h"

namespace raymill::storage {

/// 3 where `file` begins with the byte order mark of UTF-8, else 0: where its text begins. Errors: io.
Result<std::uint64_t> text_offset(const ByteSource& file);

/// A number as C writes it, with a sign, "nan" and "inf" allowed; rounded once to float32. A finite number beyond
/// float32 becomes the largest one, as round_once() does. False where `word` is anything else.
bool parse_float(std::string_view word, float& value);
/// The same, rounded once to float64, whose largest number stands for what is beyond it.
bool parse_double(std::string_view word, double& value);
/// parse_float() less `origin`: with an origin it is subtracted in float64, then rounded to float32.
bool parse_coordinate(std::string_view word, double origin, float& value);
/// A whole number in decimal. False where `word` is anything else, or beyond 64 bits.
bool parse_integer(std::string_view word, std::int64_t& value);

class TextReader {
 public:
  /// Longer words come in pieces; no number is that long.
  static constexpr std::size_t kMostWordBytes = 4096;
  struct Style {
    bool comments = false;       ///< "#" hides what is left of the line
    bool continuations = false;  ///< a backslash at the line's end takes the next line in
  };

  TextReader(const ByteSource& file, std::uint64_t offset, Style style) : window_(file, offset), style_(style) {}

  /// The next word of this line, empty at the line's end. Valid until the next call.
  std::string_view word();
  /// The next word of this or a later line, empty at the end of the file. Valid until the next call.
  std::string_view word_of_any_line();
  /// What is left of this line, blanks at both ends left out, at most `most` bytes of it.
  std::string rest_of_line(std::size_t most);
  /// Goes to the start of the next line; false at the end of the file.
  bool next_line();

  /// Number of the line, from 1, as an editor counts (line feeds).
  [[nodiscard]] std::uint64_t line() const { return line_; }
  /// The first error of a read; words and lines end there.
  [[nodiscard]] const Status& status() const { return window_.status(); }

 private:
  std::string_view peek(std::size_t least);
  [[nodiscard]] std::size_t continuation_bytes(std::string_view text) const;
  void skip_blanks();

  ByteWindow window_;
  const Style style_;
  std::uint64_t line_ = 1;
};

}  // namespace raymill::storage
