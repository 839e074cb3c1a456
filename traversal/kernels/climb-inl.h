// The way up: nodes above the one where a ray was taken up, compiled once per ISA. The includer defines RAYMILL_ISA and
// includes its simd header first.
#pragma once

#include "traversal/kernels/box_test-inl.h"
#include "traversal/kernels/lane-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

// The entry distances at a node whose mask came from elsewhere. False: the mask is not of that node.
template <int N, Mode kMode, typename RayLane>
[[gnu::noinline]] bool measure(RayLane* lane, unsigned level) {
  const Node<N>& node = *lane->places[level].node;
  test_boxes<N, kMode>(node, lane->frame, lane->tnear, lane->tfar, lane->entries[level]);
  return (lane->levels >> level & 1) == 0 || (lane->masks[level] & ~node.valid) == 0;
}

// A pop comes to a level above the node where the ray was taken up.
template <int N, Mode kMode, typename RayLane>
[[gnu::noinline]] bool climb(RayLane* lane, unsigned level) {
  Place<N> place = lane->places[lane->top];
  while (place.node->level > level) {
    place.node = place.node_at(place.node->parent);
  }
  if (place.node->level != level) {
    return false;
  }
  lane->places[level] = place;
  lane->top = level;
  return measure<N, kMode>(lane, level);
}

}  // namespace raymill::traversal::RAYMILL_ISA
