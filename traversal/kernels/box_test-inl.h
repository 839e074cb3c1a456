// The box test of nodes: as they stand in pages, and what it has in common for those of the expanded layout. Compiled
// once per ISA. The includer defines RAYMILL_ISA and includes its simd header first.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <limits>

#include "storage/pages/page_image.h"
#include "traversal/kernels/exact-inl.h"
#include "traversal/kernels/triangle-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

using storage::Node;

// Which of N boxes the ray meets, by the interval in each, and where that begins.
template <int N, Mode kMode>
[[gnu::always_inline]] inline unsigned meets_interval(const NearFar<N>& interval, float tfar,
                                                      std::array<float, N>& entries) {
  Floats<N> exit = interval.far();
  exit = exit + abs(exit) * Floats<N>::broadcast(kExitPad);
  if constexpr (kMode == Mode::exact) {
    exit = exit + Floats<N>::broadcast(kExactSlack);
  }
  interval.near().store(entries.data());
  // In this order an exit of -inf, which the pad turns into NaN, is kept and compares false: the box lies behind, or
  // beside an axis-parallel ray.
  return less_equal(interval.near(), min_keep(Floats<N>::broadcast(end_of<kMode>(tfar)), exit));
}

// The slab test of slab.h for all children of a node: those whose interval meets [tnear, tfar], and where it begins.
template <int N, Mode kMode>
[[gnu::always_inline]] inline unsigned test_boxes(const Node<N>& node, const RayFrame& ray, float tnear, float tfar,
                                                  std::array<float, N>& entries) {
  auto interval = NearFar<N>::broadcast(begin_of<kMode>(tnear), std::numeric_limits<float>::infinity());
  for (int axis = 0; axis < 3; ++axis) {
    const float scale = std::bit_cast<float>(static_cast<std::uint32_t>(node.exponent[axis] + 127) << 23);
    const auto planes = NearFar<N>::from_bytes(node.lower, node.upper, axis, (ray.octant >> axis & 1) != 0);
    interval.tighten((planes * scale + node.base[axis] - ray.org[axis]) * ray.rdir[axis]);
  }
  return meets_interval<N, kMode>(interval, tfar, entries) & node.valid;
}

}  // namespace raymill::traversal::RAYMILL_ISA
