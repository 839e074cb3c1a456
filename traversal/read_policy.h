// ReadPolicy: which of the pages that rays wait for is read next. One small interface, one class for each policy.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "storage/base/status.h"

namespace raymill::traversal {

enum class ReadOrder : std::uint8_t {
  score,      ///< most rays for each byte to read
  most_rays,  ///< most rays
  fifo,       ///< longest wanted
  sweep       ///< in the file's order, round and round, leaving out pages that few rays want
};
std::string_view to_string(ReadOrder order);
/// "score", "most-rays", "fifo", "sweep". Errors: invalid_argument.
Result<ReadOrder> parse_read_order(const std::string& name);

/// Thread-confined (the owner's lock).
class ReadPolicy {
 public:
  virtual ~ReadPolicy() = default;
  /// So many rays wait for the absent page now; 0: it is no candidate (any more).
  virtual void update(std::uint32_t page, std::uint32_t rays) = 0;
  /// The next page; it stays a candidate.
  virtual std::optional<std::uint32_t> next() = 0;
};

/// `encoded_bytes(page)`: what a read of the page costs.
std::unique_ptr<ReadPolicy> make_read_policy(ReadOrder order, std::uint32_t page_count,
                                             std::function<std::uint32_t(std::uint32_t)> encoded_bytes);
/// Memory of the largest policy.
std::uint64_t read_policy_bytes(std::uint32_t page_count);

}  // namespace raymill::traversal
