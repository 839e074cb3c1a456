// RayOrder: an order of rays in which neighbours in the batch are neighbours in space: by the Morton code of the
// origin, 8 bits an axis within the rays' box, then by octant. Rays that follow each other then find each other's nodes
// in the caches. Any numbers will do: rays that are no numbers come somewhere. Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "traversal/query.h"

namespace raymill::traversal {

/// What EngineConfig::sort_rays names.
enum class SortRays : std::uint8_t { automatic, never, always };
/// "auto", "never" or "always". Errors: invalid_argument.
Result<SortRays> parse_sort_rays(const std::string& name);

class RayOrder {
 public:
  /// Of an order of so many rays.
  static constexpr std::size_t bytes(std::size_t rays) { return rays * (2 * sizeof(Keyed) + sizeof(std::uint32_t)); }

  /// The rays' indices in that order; equal keys keep theirs. At most 2^32 rays. About 20 ns a ray (speed.md). Valid
  /// until the next call.
  std::span<const std::uint32_t> sort(std::span<const Ray> rays);

  /// Whether sorting would bring neighbours together that are not beside each other already: by a sample of pairs that
  /// follow each other.
  static bool is_scattered(std::span<const Ray> rays);

 private:
  struct Keyed {
    std::uint32_t key, index;
  };
  void make_keys(std::span<const Ray> rays);

  std::vector<Keyed> keys_, other_;
  std::vector<std::uint32_t> order_;
};

}  // namespace raymill::traversal
