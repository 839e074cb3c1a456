// MaskSink: what takes the masks of a scene and what they do to its triangles. AlphaMap: a texture's alpha in memory.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/mask.h"
#include "storage/base/status.h"

namespace raymill::storage {

/// Texels row by row, the top row first; of 1 bit (least significant first), 8 or 16 bits (little-endian).
struct AlphaMap {
  MaskInfo info;
  std::size_t row_bytes = 0;
  std::vector<std::byte> texels;

  static std::size_t bytes_of_row(std::uint32_t width, std::uint32_t bits) {
    return (std::size_t{width} * bits + 63) / 64 * 8;
  }
  [[nodiscard]] const std::byte* row(std::uint32_t y) const { return texels.data() + y * row_bytes; }
  [[nodiscard]] std::uint32_t value(std::uint32_t x, std::uint32_t y) const {
    const std::byte* at = row(y);
    switch (info.bits) {
      case 1:
        return static_cast<std::uint32_t>(at[x / 8] >> (x % 8)) & 1U;
      case 8:
        return static_cast<std::uint32_t>(at[x]);
      default:
        return static_cast<std::uint32_t>(at[2 * std::size_t{x}]) |
               static_cast<std::uint32_t>(at[2 * std::size_t{x} + 1]) << 8;
    }
  }
};

/// What a mask does to a triangle.
struct FaceMask {
  static constexpr std::uint32_t kOpaque = 0xFFFFFFFF;  ///< in `mask`: nothing of it is cut out
  static constexpr std::uint32_t kCut = 0xFFFFFFFE;     ///< nothing of it is left

  TexCoords corners{};
  std::array<float, 3> alphas{1, 1, 1};  ///< of the corners
  std::uint32_t mask = kOpaque;          ///< number of a mask
  std::uint32_t known = 0;               ///< cells of its rectangle (base/mask.h)
};

/// Which sides of a geometry's triangles are hit.
enum class Sides : std::uint8_t { both = 0, counterclockwise = 1, clockwise = 2 };

struct GeometryMask {
  static constexpr std::uint64_t kNoFaces = ~std::uint64_t{0};
  std::uint64_t first_face = kNoFaces;  ///< of primitive 0; the others follow
  Sides sides = Sides::both;
};

/// Called from the thread that calls the TriangleSink.
class MaskSink {
 public:
  virtual ~MaskSink() = default;
  /// Keeps a mask; gives its number. Errors: disk_full, io.
  virtual Result<std::uint32_t> add_mask(const AlphaMap& map) = 0;
  /// Keeps faces; gives the number of the first of them. Those of one geometry come one after the other.
  /// Errors: disk_full, io.
  virtual Result<std::uint64_t> add_faces(std::span<const FaceMask> faces) = 0;
  /// Faces that were kept before. Errors: io.
  virtual Status read_faces(std::uint64_t first, std::span<FaceMask> faces) = 0;
  /// Says what is to be known of the triangles that come under this id: to the object that comes in, else to the scene.
  virtual void set_masks(std::uint32_t geometry_id, const GeometryMask& masks) = 0;
};

}  // namespace raymill::storage
