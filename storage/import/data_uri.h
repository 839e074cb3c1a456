// DataUri: `data:[type][;base64],...` (RFC 2397) and percent-encoding (RFC 3986). Stateless; thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace raymill::storage {

inline bool is_data_uri(std::string_view uri) { return uri.starts_with("data:"); }

/// Upper bound of the bytes that decode_data_uri() gives, for the claim before it.
std::uint64_t data_uri_bytes_max(std::string_view uri);

/// The bytes of a base64 data URI; nothing where it is not base64 or holds a character that base64 has not. Padding may
/// be missing.
std::optional<std::vector<std::byte>> decode_data_uri(std::string_view uri);

/// `%20` and its like resolved; nothing where a percent sign is not followed by two hexadecimal digits.
std::optional<std::string> percent_decode(std::string_view uri);

}  // namespace raymill::storage
