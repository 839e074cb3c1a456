// Conservative 8-bit boxes: the frame of a node and the planes of its children.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "storage/base/vec3.h"

namespace raymill::storage {

/// One axis of a node: plane = base + q * 2^exponent.
struct AxisFrame {
  float base = 0;
  std::int8_t exponent = -126;
};

/// The smallest frame whose 256 planes reach from `lower` to `upper` (finite, lower <= upper).
AxisFrame choose_frame(float lower, float upper);

/// Largest q whose plane is not above `value`, and smallest whose plane is not below; empty where there is none.
/// The search compares decoded planes, so rounding of base + q * 2^exponent cannot break the promise.
std::optional<std::uint8_t> quantize_lower(const AxisFrame& frame, float value);
std::optional<std::uint8_t> quantize_upper(const AxisFrame& frame, float value);

}  // namespace raymill::storage
