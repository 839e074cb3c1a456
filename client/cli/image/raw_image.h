// The file that hands a picture from raymill to raymill-image: this header, then height rows of width x channels
// float32 values, top row first. Both ends run on one machine, one after the other; it is no format to keep.
#pragma once

#include <cstdint>
#include <type_traits>

namespace raymill::client {

constexpr std::uint64_t kRawImageMagic = 0x314547414D494D52u;  // "RMIMAGE1"

/// How the values become the colours of an 8-bit picture. A float picture keeps the values.
enum class Tone : std::uint32_t {
  distance,   ///< one value; near is bright, by the logarithm between low and high; +inf is black
  direction,  ///< three values in [-1, 1]
  linear,     ///< one value in [0, 1]
  radiance    ///< three values from 0 up, tone-mapped
};

struct RawImageHeader {
  std::uint64_t magic = kRawImageMagic;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::uint32_t channels = 0;
  Tone tone = Tone::radiance;
  float low = 0;  ///< Tone::distance: least and largest distance in the picture
  float high = 0;
};
static_assert(sizeof(RawImageHeader) == 32 && std::is_trivially_copyable_v<RawImageHeader>);

}  // namespace raymill::client
