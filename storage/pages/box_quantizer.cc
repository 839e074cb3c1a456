#include "storage/pages/box_quantizer.h"

#include <algorithm>
#include <cmath>

#include "storage/pages/page_image.h"

namespace raymill::storage {
namespace {

float plane(const AxisFrame& frame, int q) {
  return decode_plane(frame.base, power_of_two(frame.exponent), static_cast<std::uint8_t>(q));
}

// Where value lies in steps of the frame; a first guess that the callers correct.
int guess(const AxisFrame& frame, float value) {
  const double steps = std::ldexp(double(value) - double(frame.base), -frame.exponent);
  return static_cast<int>(std::clamp(steps, 0.0, 255.0));
}

}  // namespace

AxisFrame choose_frame(float lower, float upper) {
  AxisFrame frame{lower, -126};
  const double extent = double(upper) - double(lower);
  if (extent > 0) {
    const int exponent = std::ilogb(extent / 255.0);
    frame.exponent = static_cast<std::int8_t>(std::clamp(exponent, -126, 127));
  }
  while (plane(frame, 255) < upper && frame.exponent < 127) {
    ++frame.exponent;
  }
  return frame;
}

std::optional<std::uint8_t> quantize_lower(const AxisFrame& frame, float value) {
  int q = guess(frame, value);
  while (q > 0 && plane(frame, q) > value) {
    --q;
  }
  while (q < 255 && plane(frame, q + 1) <= value) {
    ++q;
  }
  return plane(frame, q) <= value ? std::optional(static_cast<std::uint8_t>(q)) : std::nullopt;
}

std::optional<std::uint8_t> quantize_upper(const AxisFrame& frame, float value) {
  int q = std::min(guess(frame, value) + 1, 255);
  while (q < 255 && plane(frame, q) < value) {
    ++q;
  }
  while (q > 0 && plane(frame, q - 1) >= value) {
    --q;
  }
  return plane(frame, q) >= value ? std::optional(static_cast<std::uint8_t>(q)) : std::nullopt;
}

}  // namespace raymill::storage
