// Which child of a node comes next, compiled once per ISA.
#pragma once

#include <cstdint>

#include "storage/pages/page_image.h"

namespace raymill::traversal::RAYMILL_ISA {

// kFirst[octant][mask]: the slot of mask that comes first when slots are visited by rising slot XOR octant.
struct FirstSlotTable {
  std::uint8_t slot[8][256] = {};
  constexpr FirstSlotTable() {
    for (unsigned octant = 0; octant < 8; ++octant) {
      for (unsigned mask = 1; mask < 256; ++mask) {
        unsigned rank = 0;
        while ((mask >> (rank ^ octant) & 1) == 0) {
          ++rank;
        }
        slot[octant][mask] = static_cast<std::uint8_t>(rank ^ octant);
      }
    }
  }
};
inline constexpr FirstSlotTable kFirst;

/// Of a node of either layout.
template <int N, typename NodeOf>
unsigned first_slot(const NodeOf& node, unsigned octant, unsigned mask) {
  if constexpr (N == 4) {
    octant = (octant >> (node.order & 3) & 1) | (octant >> (node.order >> 2) & 1) << 1;
  }
  return kFirst.slot[octant][mask];
}

}  // namespace raymill::traversal::RAYMILL_ISA
