// Alpha masks: which texel of a texture a point of a triangle falls on, and whether it counts there. What the import,
// the pages and traversal share, so that all of them round alike. Normative: storage/MASKS.md.
//
//   point of the triangle (u, v) --> texture coordinates --> texel, before it is wrapped --> wrapped --> value
//
// Everything is float64, each operation rounded once. Plain values; immutable.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <type_traits>

namespace raymill::storage {

/// What a coordinate outside the texture means.
enum class Wrap : std::uint8_t { repeat = 0, mirror = 1, clamp = 2 };

/// Texels along an edge of a texture, at most.
constexpr std::uint32_t kMostMaskEdge = 1u << 16;
/// Largest magnitude of a texture coordinate: a texel's number stays exact in float64 with room to spare.
constexpr float kMostTexCoord = 0x1p+24F;
/// Texels of a tile's edge.
constexpr std::uint32_t kTileEdge = 64;
constexpr std::uint32_t kTileTexels = kTileEdge * kTileEdge;
constexpr std::uint32_t tile_bytes(std::uint32_t bits) { return kTileTexels * bits / 8; }

/// A texture's alpha and what it is held against.
struct MaskInfo {
  std::uint32_t width = 1;
  std::uint32_t height = 1;
  std::uint8_t bits = 1;  ///< of a texel: 1 (whether it counts), 8 or 16 (its alpha)
  Wrap wrap_s = Wrap::repeat;
  Wrap wrap_t = Wrap::repeat;
  std::uint8_t reserved = 0;
  std::uint32_t reserved_too = 0;
  double factor = 1;  ///< of the material's alpha, 0 to 1
  double cutoff = 0.5;
};
static_assert(sizeof(MaskInfo) == 32 && std::is_trivially_copyable_v<MaskInfo>);

/// Texture coordinates of a triangle's corners.
using TexCoords = std::array<std::array<float, 2>, 3>;

struct TexelPoint {
  double x = 0, y = 0;  ///< in texels, y downwards
};

/// What corners' values are at a point of the triangle. Where all three are equal it is their value, however u and v
/// were rounded: textures often have a border of texels there.
inline double between(double c0, double c1, double c2, double u, double v) {
  return c0 + u * (c1 - c0) + v * (c2 - c0);
}

/// Where the point (1-u-v) c0 + u c1 + v c2 falls.
inline TexelPoint texel_point(const TexCoords& corners, double u, double v, std::uint32_t width, std::uint32_t height) {
  return {between(corners[0][0], corners[1][0], corners[2][0], u, v) * width,
          between(corners[0][1], corners[1][1], corners[2][1], u, v) * height};
}

/// The texel of the texture that texel `at` of the plane stands for.
inline std::uint32_t wrap_texel(std::int64_t at, std::uint32_t size, Wrap wrap) {
  const std::int64_t n = size;
  if (wrap == Wrap::clamp) {
    return static_cast<std::uint32_t>(at < 0 ? 0 : at >= n ? n - 1 : at);
  }
  const std::int64_t period = wrap == Wrap::mirror ? 2 * n : n;
  std::int64_t in = at % period;
  in += in < 0 ? period : 0;
  return static_cast<std::uint32_t>(in < n ? in : period - 1 - in);
}

/// Whether a texel of this value counts: (value / most) factor alpha >= cutoff; `most` is 255 or 65535.
inline bool counts(std::uint32_t value, std::uint32_t most, double factor, double alpha, double cutoff) {
  return double(value) / most * factor * alpha >= cutoff;
}

/// The least value that counts; most + 1: none does. The rule is monotone in the value.
inline std::uint32_t least_counting(std::uint32_t most, double factor, double alpha, double cutoff) {
  std::uint32_t low = 0, high = most + 1;
  while (low < high) {
    const std::uint32_t middle = (low + high) / 2;
    if (counts(middle, most, factor, alpha, cutoff)) {
      high = middle;
    } else {
      low = middle + 1;
    }
  }
  return low;
}

/// What is known about a quarter by a quarter of a triangle's rectangle of texels.
enum class CellState : std::uint8_t { look_up = 0, opaque = 1, cut = 2 };
constexpr std::uint32_t kCells = 4;  ///< along each edge of the rectangle

/// The least rectangle of unwrapped texels that holds a triangle's corners.
struct TexelRectangle {
  std::int64_t x = 0, y = 0;
  std::int64_t width = 1, height = 1;
};
inline TexelRectangle texel_rectangle(const TexCoords& corners, std::uint32_t width, std::uint32_t height) {
  std::array<double, 2> low{}, high{};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const double a = corners[0][axis], b = corners[1][axis], c = corners[2][axis];
    low[axis] = std::fmin(std::fmin(a, b), c) * (axis == 0 ? width : height);
    high[axis] = std::fmax(std::fmax(a, b), c) * (axis == 0 ? width : height);
  }
  TexelRectangle out;
  out.x = static_cast<std::int64_t>(std::floor(low[0]));
  out.y = static_cast<std::int64_t>(std::floor(low[1]));
  out.width = static_cast<std::int64_t>(std::floor(high[0])) - out.x + 1;
  out.height = static_cast<std::int64_t>(std::floor(high[1])) - out.y + 1;
  return out;
}

/// The cell that a texel lies in, or nothing known where it lies outside.
inline CellState cell_state(std::uint32_t known, const TexelRectangle& box, std::int64_t x, std::int64_t y) {
  const std::int64_t dx = x - box.x, dy = y - box.y;
  if (known == 0 || dx < 0 || dy < 0 || dx >= box.width || dy >= box.height) {
    return CellState::look_up;
  }
  const std::int64_t cell = dy * kCells / box.height * kCells + dx * kCells / box.width;
  return static_cast<CellState>(known >> (2 * cell) & 3);
}

}  // namespace raymill::storage
