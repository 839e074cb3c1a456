#include "client/cli/parse.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>

#include "storage/base/quotes.h"

namespace raymill::client {

namespace {

constexpr std::uint32_t kMaxSidePixels = 65536;

Status refuse(std::string_view text, const char* expected) {
  return {ErrorCode::invalid_argument, in_quotes(text) + " is not " + expected};
}

template <typename T>
bool take_number(std::string_view& text, T& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc()) {
    return false;
  }
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return true;
}

// Power of the unit's letter, 0 for none, -1 for a letter that is no unit.
int take_unit(std::string_view& text) {
  if (text.empty()) {
    return 0;
  }
  constexpr std::string_view kLetters = "kKmMgGtT";
  const std::size_t at = kLetters.find(text.front());
  if (at == std::string_view::npos) {
    return text.front() == 'B' ? 0 : -1;
  }
  text.remove_prefix(1);
  return static_cast<int>(at / 2) + 1;
}

}  // namespace

Result<std::uint64_t> parse_bytes(std::string_view text) {
  constexpr const char* kExpected = "a size in bytes such as 512M, 2G or 65536";
  std::string_view rest = text;
  std::uint64_t value = 0;
  if (!take_number(rest, value)) {
    return refuse(text, kExpected);
  }
  const int power = take_unit(rest);
  if (power < 0 || !(rest.empty() || rest == "B" || (rest == "iB" && power > 0))) {
    return refuse(text, kExpected);
  }
  const int shift = 10 * power;
  if (value > (std::numeric_limits<std::uint64_t>::max() >> shift)) {
    return refuse(text, kExpected);
  }
  return value << shift;
}

Result<std::uint64_t> parse_count(std::string_view text) {
  constexpr const char* kExpected = "a count such as 20M, 300k or 1000";
  std::string_view rest = text;
  double value = 0;
  if (!take_number(rest, value) || !(value >= 0)) {
    return refuse(text, kExpected);
  }
  const int power = take_unit(rest);
  if (power < 0 || !rest.empty()) {
    return refuse(text, kExpected);
  }
  value = std::round(value * std::pow(1000.0, power));
  // 2^53: below it every whole number is a double.
  if (!(value <= 0x1p53)) {
    return refuse(text, kExpected);
  }
  return static_cast<std::uint64_t>(value);
}

Result<Extent> parse_extent(std::string_view text) {
  constexpr const char* kExpected = "an image size such as 1280x720 (each side 1 to 65536 pixels)";
  std::string_view rest = text;
  Extent extent;
  if (!take_number(rest, extent.width) || rest.empty() || rest.front() != 'x') {
    return refuse(text, kExpected);
  }
  rest.remove_prefix(1);
  if (!take_number(rest, extent.height) || !rest.empty() || extent.width == 0 || extent.height == 0 ||
      extent.width > kMaxSidePixels || extent.height > kMaxSidePixels) {
    return refuse(text, kExpected);
  }
  return extent;
}

Result<std::vector<double>> parse_numbers(std::string_view text) {
  constexpr const char* kExpected = "a list of numbers such as 1,2.5,-3";
  std::vector<double> numbers;
  std::string_view rest = text;
  while (true) {
    double value = 0;
    if (!take_number(rest, value) || !std::isfinite(value)) {
      return refuse(text, kExpected);
    }
    numbers.push_back(value);
    if (rest.empty()) {
      return numbers;
    }
    if (rest.front() != ',') {
      return refuse(text, kExpected);
    }
    rest.remove_prefix(1);
  }
}

Result<double> parse_length(std::string_view text) {
  const auto numbers = parse_numbers(text);
  if (!numbers || numbers->size() != 1 || numbers->front() < 0) {
    return refuse(text, "a number from 0 up, such as 0.001");
  }
  return numbers->front();
}

Result<std::vector<double>> parse_lengths(std::string_view text) {
  auto numbers = parse_numbers(text);
  if (!numbers || std::any_of(numbers->begin(), numbers->end(), [](double value) { return value <= 0; })) {
    return refuse(text, "a list of numbers above 0, such as 0.01,0.1");
  }
  return numbers;
}

}  // namespace raymill::client
