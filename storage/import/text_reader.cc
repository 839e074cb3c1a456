#include "storage/import/text_reader.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>

#include "storage/import/transform.h"

namespace raymill::storage {

namespace {

bool is_line_end(char c) { return c == '\n' || c == '\r'; }
bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\v' || c == '\f'; }
bool ends_word(char c) { return is_blank(c) || is_line_end(c); }

// from_chars takes no plus sign.
std::string_view without_plus(std::string_view word) {
  const bool plus = word.size() > 1 && word[0] == '+' && word[1] != '-';
  return plus ? word.substr(1) : word;
}

template <typename T>
std::errc parse_whole(std::string_view word, T& value) {
  const char* end = word.data() + word.size();
  const auto [stop, error] = std::from_chars(word.data(), end, value);
  return stop == end ? error : std::errc::invalid_argument;
}

}  // namespace

Result<std::uint64_t> text_offset(const ByteSource& file) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (file.size_bytes() < kMark.size()) {
    return std::uint64_t{0};
  }
  std::array<char, kMark.size()> head;
  RAYMILL_RETURN_IF_ERROR(file.read(0, std::as_writable_bytes(std::span(head))));
  return std::string_view(head.data(), head.size()) == kMark ? std::uint64_t{kMark.size()} : std::uint64_t{0};
}

bool parse_float(std::string_view word, float& value) {
  word = without_plus(word);
  const std::errc error = parse_whole(word, value);
  if (error != std::errc::result_out_of_range) {
    return error == std::errc();
  }
  // Beyond float32 at one end or the other.
  double wide = 0;
  const bool good = parse_double(word, wide);
  value = round_once(wide);
  return good;
}

bool parse_coordinate(std::string_view word, double origin, float& value) {
  if (origin == 0) {
    return parse_float(word, value);
  }
  double wide = 0;
  const bool good = parse_double(word, wide);
  value = round_once(wide - origin);
  return good;
}

bool parse_double(std::string_view word, double& value) {
  word = without_plus(word);
  const std::errc error = parse_whole(word, value);
  if (error == std::errc::result_out_of_range) {
    const bool tiny = word.find("e-") != std::string_view::npos || word.find("E-") != std::string_view::npos;
    value = std::copysign(tiny ? 0 : std::numeric_limits<double>::max(), word[0] == '-' ? -1.0 : 1.0);
    return true;
  }
  return error == std::errc();
}

bool parse_integer(std::string_view word, std::int64_t& value) {
  return parse_whole(without_plus(word), value) == std::errc();
}

std::string_view TextReader::peek(std::size_t least) {
  const std::span<const std::byte> bytes = window_.peek(least);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Of a backslash and the line's end at the start of `text`; 0 where it is none.
std::size_t TextReader::continuation_bytes(std::string_view text) const {
  if (!style_.continuations || text.size() < 2 || text[0] != '\\' || !is_line_end(text[1])) {
    return 0;
  }
  return text.substr(1).starts_with("\r\n") ? 3 : 2;
}

void TextReader::skip_blanks() {
  while (true) {
    const std::string_view text = peek(kMostWordBytes);
    std::size_t blanks = 0;
    while (blanks < text.size() && is_blank(text[blanks])) {
      ++blanks;
    }
    window_.take(blanks);
    const std::size_t continuation = continuation_bytes(peek(kMostWordBytes));
    window_.take(continuation);
    line_ += continuation != 0 ? 1 : 0;
    if (blanks == 0 && continuation == 0) {
      return;
    }
  }
}

std::string_view TextReader::word() {
  skip_blanks();
  const std::string_view text = peek(kMostWordBytes);
  if (text.empty() || (style_.comments && text[0] == '#')) {
    return {};
  }
  const std::size_t most = std::min(text.size(), kMostWordBytes);
  std::size_t size = 0;
  while (size < most && !ends_word(text[size]) && !(text[size] == '\\' && continuation_bytes(text.substr(size)) != 0)) {
    ++size;
  }
  window_.take(size);
  return text.substr(0, size);
}

std::string_view TextReader::word_of_any_line() {
  while (true) {
    const std::string_view found = word();
    if (!found.empty() || !next_line()) {
      return found;
    }
  }
}

std::string TextReader::rest_of_line(std::size_t most) {
  skip_blanks();
  std::string rest;
  while (true) {
    const std::string_view text = peek(1);
    std::size_t size = 0;
    while (size < text.size() && !is_line_end(text[size])) {
      ++size;
    }
    rest.append(text.substr(0, std::min(size, most - rest.size())));
    window_.take(size);
    if (size < text.size() || text.empty()) {
      break;
    }
  }
  rest.erase(std::find_if_not(rest.rbegin(), rest.rend(), is_blank).base(), rest.end());
  return rest;
}

bool TextReader::next_line() {
  while (true) {
    const std::string_view text = peek(1);
    if (text.empty()) {
      return false;
    }
    const std::size_t end = text.find_first_of("\n\r");
    window_.take(std::min(end, text.size()));
    if (end == std::string_view::npos) {
      continue;
    }
    // Both of a pair, wherever the buffer ends.
    const std::string_view pair = peek(2);
    const std::size_t size = pair.starts_with("\r\n") ? 2 : 1;
    line_ += pair[size - 1] == '\n' ? 1 : 0;
    window_.take(size);
    return true;
  }
}

}  // namespace raymill::storage
