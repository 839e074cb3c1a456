// Rays sorted so that neighbours in the batch are neighbours in space: by the Morton code of the origin, 8 bits an axis
// within the batch's box, then by octant.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "traversal/query.h"

namespace raymill::bench {

/// The rays' indices in that order; equal keys keep theirs. At most 2^32 rays. About 30 ns a ray.
std::vector<std::uint32_t> sorted_order(std::span<const Ray> rays);

/// Traces rays in sorted order by trace(rays, hits) and puts the hits where they belong.
template <typename Trace>
auto trace_sorted(std::span<const Ray> rays, std::span<Hit> hits, Trace&& trace) {
  const std::vector<std::uint32_t> order = sorted_order(rays);
  std::vector<Ray> sorted(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    sorted[i] = rays[order[i]];
  }
  std::vector<Hit> found(rays.size());
  auto result = trace(std::span<const Ray>(sorted), std::span<Hit>(found));
  for (std::size_t i = 0; i < rays.size(); ++i) {
    hits[order[i]] = found[i];
  }
  return result;
}

}  // namespace raymill::bench
