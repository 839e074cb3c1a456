#include "storage/import/data_uri.h"

#include <array>

namespace raymill::storage {

namespace {

constexpr std::string_view kAlphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
constexpr std::uint8_t kNotInAlphabet = 64;

constexpr std::array<std::uint8_t, 256> make_sextets() {
  std::array<std::uint8_t, 256> sextets{};
  sextets.fill(kNotInAlphabet);
  for (std::size_t i = 0; i < kAlphabet.size(); ++i) {
    sextets[static_cast<unsigned char>(kAlphabet[i])] = static_cast<std::uint8_t>(i);
  }
  return sextets;
}
constexpr std::array<std::uint8_t, 256> kSextets = make_sextets();

// The encoded part, or nothing where the URI is not base64.
std::optional<std::string_view> base64_part(std::string_view uri) {
  constexpr std::string_view kMark = ";base64";
  const std::size_t comma = uri.find(',');
  if (comma == std::string_view::npos || !uri.substr(0, comma).ends_with(kMark)) {
    return std::nullopt;
  }
  return uri.substr(comma + 1);
}

int hex_digit(char c) {
  return c >= '0' && c <= '9'   ? c - '0'
         : c >= 'a' && c <= 'f' ? c - 'a' + 10
         : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                : -1;
}

}  // namespace

std::uint64_t data_uri_bytes_max(std::string_view uri) { return uri.size() / 4 * 3 + 3; }

std::optional<std::vector<std::byte>> decode_data_uri(std::string_view uri) {
  std::optional<std::string_view> text = base64_part(uri);
  if (!text) {
    return std::nullopt;
  }
  for (int padding = 0; padding < 2 && text->ends_with('='); ++padding) {
    text->remove_suffix(1);
  }
  if (text->size() % 4 == 1) {
    return std::nullopt;  // six bits are no byte
  }
  std::vector<std::byte> bytes;
  bytes.reserve(data_uri_bytes_max(uri));
  std::uint32_t bits = 0;
  int bit_count = 0;
  for (const char c : *text) {
    const std::uint8_t sextet = kSextets[static_cast<unsigned char>(c)];
    if (sextet == kNotInAlphabet) {
      return std::nullopt;
    }
    bits = (bits << 6 | sextet) & 0xFFFFFF;
    bit_count += 6;
    if (bit_count >= 8) {
      bit_count -= 8;
      bytes.push_back(static_cast<std::byte>(bits >> bit_count & 0xFF));
    }
  }
  return bytes;
}

std::optional<std::string> percent_decode(std::string_view uri) {
  std::string text;
  text.reserve(uri.size());
  for (std::size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] != '%') {
      text += uri[i];
      continue;
    }
    const int high = i + 2 < uri.size() ? hex_digit(uri[i + 1]) : -1;
    const int low = i + 2 < uri.size() ? hex_digit(uri[i + 2]) : -1;
    if (high < 0 || low < 0) {
      return std::nullopt;
    }
    text += static_cast<char>(high * 16 + low);
    i += 2;
  }
  return text;
}

}  // namespace raymill::storage
