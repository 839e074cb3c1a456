// Whether a hit on a triangle counts where masks cut triangles out or sides are culled: storage/MASKS.md.
//
// The barycentrics that the texel is found by are computed here, in float64 by the formula of the watertight test and
// its edge functions as they stand, whatever the mode and the query: so they all agree on what is cut out. Compiled
// once, for the architecture's least machine. Immutable; thread-safe. Callers hold an IeeeScope.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "storage/pages/masked_section.h"

namespace raymill::traversal {

struct MaskHit {
  std::array<float, 3> org;  ///< in the triangle's space
  std::array<float, 3> dir;
  std::array<std::array<float, 3>, 3> corners;
  double u = 0, v = 0;  ///< of the mode's own test: stands in where float64 sees the triangle edge-on
};

struct MaskAnswer {
  enum class What : std::uint8_t { counts, cut, look_up } what = What::counts;
  // Where the texel stands, and the least value that counts:
  std::uint32_t page = 0;
  std::uint32_t texel = 0;
  std::uint16_t least = 0;
  std::uint8_t bits = 0;
};

/// `image` is of a masked page (MaskSectionView::has_masks).
MaskAnswer test_mask(const std::byte* image, std::uint32_t triangle, const MaskHit& hit, std::uint32_t page_bytes);

/// Looks the texel up in the image of its page. False: the page has no such texel.
bool read_texel(const std::byte* image, std::uint32_t texel, std::uint8_t bits, std::uint16_t least, bool& counts);

}  // namespace raymill::traversal
