// Which child of a wide node stands in which slot.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "storage/base/types.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

/// Slots whose order, under XOR with a ray's octant, is front to back (Ylitie, Karras, Laine 2017, section 3.2; greedy
/// instead of the auction). `box`: of the node. `order` gets what the slot bits mean for width 4.
std::array<unsigned, kMaxWidth> assign_slots(std::span<const Aabb> children, const Aabb& box, unsigned width,
                                             std::uint8_t& order);

}  // namespace raymill::storage
