// Words of the command line turned into values. Pure functions.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "storage/base/status.h"

namespace raymill::client {

/// "512M", "2G", "64K", "1T", "123": bytes; the units are powers of 1024, an "iB" or "B" may follow.
Result<std::uint64_t> parse_bytes(std::string_view text);

/// "20M", "1.5G", "300k", "123": a count; the units are powers of 1000.
Result<std::uint64_t> parse_count(std::string_view text);

struct Extent {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
};
/// "1280x720"; each side 1 to 65536.
Result<Extent> parse_extent(std::string_view text);

/// "1,2.5,-3e4": finite numbers separated by commas.
Result<std::vector<double>> parse_numbers(std::string_view text);

/// "0.001": a length or another finite number, 0 or more.
Result<double> parse_length(std::string_view text);
/// "0.1,1,10": such numbers, none of them 0.
Result<std::vector<double>> parse_lengths(std::string_view text);

}  // namespace raymill::client
