// The section of masks in a page of triangles, behind its instances.
//
//   MaskSection | index for each triangle | MaskedTriangle | MaskRef | alphas
//
// A triangle without an index is opaque. Triangles that look alike share an entry, so sides that are culled cost two
// bytes a triangle. Normative description: storage/MASKS.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>

#include "storage/base/mask.h"
#include "storage/base/status.h"
#include "storage/pages/page_image.h"

namespace raymill::storage {

class PlaneReader;
class PlaneWriter;

constexpr std::uint16_t kNoMaskIndex = 0xFFFF;

struct MaskSection {
  std::uint32_t entry_count = 0;  ///< MaskedTriangle
  std::uint32_t mask_count = 0;
  std::uint32_t alpha_count = 0;
  std::uint32_t reserved = 0;
};
static_assert(sizeof(MaskSection) == 16 && std::is_trivially_copyable_v<MaskSection>);

struct MaskedTriangle {
  TexCoords corners{};
  std::uint16_t mask = 0;              ///< of the page's; kNoMask: the triangle is not cut out
  std::uint16_t alpha = kNoMaskIndex;  ///< of the page's, where corners have alphas of their own
  std::uint32_t known = 0;             ///< two bits for each cell of its rectangle (base/mask.h)

  static constexpr std::uint16_t kMaskBits = 0x3FFF, kNoMask = 0x3FFF;
  static constexpr std::uint16_t kFrontOnly = 0x4000;       ///< in `mask`: rays from the back pass
  static constexpr std::uint16_t kFrontClockwise = 0x8000;  ///< the front is where the corners go clockwise
};
static_assert(sizeof(MaskedTriangle) == 32 && std::is_trivially_copyable_v<MaskedTriangle>);

/// A mask that triangles of the page are cut out by.
struct MaskRef {
  MaskInfo info;
  std::uint32_t first_page = 0;  ///< of its tiles
  std::uint32_t reserved = 0;
};
static_assert(sizeof(MaskRef) == 40 && std::is_trivially_copyable_v<MaskRef>);

/// At the corners; 1 in between where there is none.
using CornerAlphas = std::array<float, 3>;

/// Where the arrays of a section stand in its image.
struct MaskOffsets {
  std::uint32_t section = 0, indices = 0, entries = 0, masks = 0, alphas = 0, end = 0;
};
MaskOffsets mask_offsets(const PageHeader& header, const MaskSection& section);

/// Typed access to the section of a masked page. Immutable view.
class MaskSectionView {
 public:
  explicit MaskSectionView(const std::byte* image)
      : image_(image), offsets_(mask_offsets(header(), *at<MaskSection>(instances_end(header())))) {}
  static bool has_masks(const std::byte* image) {
    return reinterpret_cast<const PageHeader*>(image)->page_type == kPageTypeMasked;
  }
  [[nodiscard]] const MaskSection& section() const { return *at<MaskSection>(offsets_.section); }
  /// [triangle_count]
  [[nodiscard]] const std::uint16_t* indices() const { return at<std::uint16_t>(offsets_.indices); }
  [[nodiscard]] const MaskedTriangle* entries() const { return at<MaskedTriangle>(offsets_.entries); }
  [[nodiscard]] const MaskRef* masks() const { return at<MaskRef>(offsets_.masks); }
  [[nodiscard]] const CornerAlphas* alphas() const { return at<CornerAlphas>(offsets_.alphas); }

 private:
  [[nodiscard]] const PageHeader& header() const { return *reinterpret_cast<const PageHeader*>(image_); }
  template <typename T>
  [[nodiscard]] const T* at(std::uint32_t offset) const {
    return reinterpret_cast<const T*>(image_ + offset);
  }
  const std::byte* image_;
  MaskOffsets offsets_;
};

/// The size that a masked page of this header must have, by the counts that stand in it; 0 where they cannot be.
std::uint32_t image_bytes_with_masks(const PageHeader& header, std::size_t image_bytes);
/// The same where the counts are known.
std::uint32_t image_bytes_with_masks(const PageHeader& header, const MaskSection& section);
/// Checks every index, number and page of the section. Errors: corrupt.
Status check_masks(const PageView& view, const PageRules& rules);

void write_masks(const PageView& view, PlaneWriter& out);
/// The section's head stands in the image.
void read_masks(PlaneReader& in, std::byte* image);

}  // namespace raymill::storage
