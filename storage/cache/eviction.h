// Eviction: which resident page goes when another must come. One small interface, one file for each policy. No answer
// depends on it.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "storage/base/status.h"
#include "storage/base/types.h"

namespace raymill::storage {

enum class EvictionKind : std::uint8_t {
  clock,   ///< a page that was not entered since the clock's hand last passed
  demand,  ///< the page that the fewest waiting rays will still ask for
};
std::string_view to_string(EvictionKind kind);
/// "clock", "demand". Errors: invalid_argument.
Result<EvictionKind> parse_eviction(const std::string& name);

/// Who asks for a page. [page_count] each.
struct PageDemand {
  std::span<const std::uint32_t> waiting;             ///< rays that wait for the page: it stays
  std::span<const std::atomic<std::int32_t>> future;  ///< of waiting rays, how many come there later; empty: not known
};

/// Thread-confined (the owner's lock).
class Eviction {
 public:
  virtual ~Eviction() = default;
  /// The frame to give up, or empty when every page is wanted. `page_in_frame`: kNoPage where there is none.
  /// `touched[page]`: entered since it was last cleared here.
  virtual std::optional<std::uint32_t> choose(std::span<const PageId> page_in_frame, const PageDemand& demand,
                                              std::atomic<std::uint8_t>* touched) = 0;
};

std::unique_ptr<Eviction> make_eviction(EvictionKind kind);

}  // namespace raymill::storage
