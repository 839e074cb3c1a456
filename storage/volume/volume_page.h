// Pages of volumes, decoded: what stands in memory while rays run through it.
//
//   VolumePageHeader | nodes | bricks | values        bricks of one volume, and nodes above them
//   VolumePageHeader | volumes                        the table: one page of a store, named by its footer
//
// One relocatable image without pointers, like a page of triangles, in the same file, directory and cache. A node
// names its children by page and item and holds the least and the largest value that any point below a child can
// have, exactly. Normative description: storage/FORMAT.md.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/volume.h"

namespace raymill::storage {

constexpr std::uint32_t kVolumePageMagic = 0x47504D52;  // "RMPG", as all pages
constexpr std::uint16_t kPageTypeVolume = 3;
constexpr std::size_t kVolumeAlignment = 32;

enum class VolumePageKind : std::uint8_t { bricks = 0, table = 1 };

struct VolumePageHeader {
  std::uint32_t magic = kVolumePageMagic;
  std::uint16_t page_type = kPageTypeVolume;
  VolumePageKind kind = VolumePageKind::bricks;
  std::uint8_t plane_bytes = 4;  ///< of the values, when encoded: 1, 2 or 4
  std::uint32_t image_bytes = 0;
  std::uint32_t triangle_nodes = 0;  ///< always: stands where a page of triangles counts its nodes, so none leads here
  std::uint16_t node_count = 0;
  std::uint16_t brick_count = 0;
  std::uint32_t volume_count = 0;  ///< kind table
  std::uint32_t nodes_offset = 0;  ///< kind table: of the volumes
  std::uint32_t bricks_offset = 0;
  std::uint32_t values_offset = 0;
  std::uint32_t values_bytes = 0;
  std::uint32_t volume = 0;  ///< index in the table; kind table: 0
  std::array<std::uint8_t, 20> reserved{};
};
static_assert(sizeof(VolumePageHeader) == 64 && std::is_trivially_copyable_v<VolumePageHeader>);

enum class ChildKind : std::uint8_t {
  tile = 0,   ///< one value everywhere: lower == upper
  brick = 1,  ///< level 1 alone
  node = 2,   ///< above level 1
};

struct alignas(32) VolumeNode {
  Index3 origin{};
  std::uint8_t level = 1;
  std::array<std::uint8_t, 3> reserved{};
  std::array<float, kNodeChildren> lower{};
  std::array<float, kNodeChildren> upper{};
  std::array<std::uint32_t, kNodeChildren> page{};  ///< 0 for tiles
  std::array<std::uint16_t, kNodeChildren> item{};  ///< in that page: a brick or a node; 0 for tiles
  std::array<ChildKind, kNodeChildren> kind{};
};
static_assert(sizeof(VolumeNode) == 992 && std::is_trivially_copyable_v<VolumeNode>);

struct Brick {
  Index3 origin{};
  std::uint8_t value_bytes = 4;  ///< 4: float32; 1, 2: steps of the volume's lattice above `base`
  std::array<std::uint8_t, 3> reserved{};
  std::int32_t base = 0;
  std::uint32_t values_offset = 0;  ///< in the page's values
  float lower = 0;                  ///< of the values, exactly
  float upper = 0;
};
static_assert(sizeof(Brick) == 32 && std::is_trivially_copyable_v<Brick>);

/// Bytes that a brick's values take in a page.
constexpr std::uint32_t brick_bytes(std::uint32_t value_bytes) { return (kBrickValues * value_bytes + 3) / 4 * 4; }

/// A volume of the store.
struct Volume {
  Index3 origin{};  ///< of the root node, and least corner of the cells
  Index3 cells{};   ///< along each axis
  std::uint32_t geometry_id = 0;
  VolumeKind kind = VolumeKind::fog;
  std::uint8_t lattice = 0;  ///< values are multiples of 2^step_exponent
  std::uint8_t levels = 1;   ///< of the root node
  std::uint8_t reserved = 0;
  std::int32_t step_exponent = 0;
  std::uint32_t root_page = 0;
  std::uint16_t root_node = 0;
  std::array<std::uint8_t, 2> reserved_too{};
  float background = 0;
  float lower = 0;  ///< of all values
  float upper = 0;
  std::uint64_t brick_count = 0;
  std::uint64_t active_voxels = 0;
  Affine world_from_index{};
  Affine index_from_world{};
};
static_assert(sizeof(Volume) == 264 && std::is_trivially_copyable_v<Volume>);

/// Volumes that a store's table has room for.
constexpr std::uint32_t most_volumes(std::uint32_t page_bytes) {
  return (page_bytes - sizeof(VolumePageHeader)) / sizeof(Volume);
}

/// Fills offsets and image_bytes from the counts and values_bytes.
void lay_out(VolumePageHeader& header);

/// Typed access to an image. Immutable view; the image must outlive it.
class VolumePageView {
 public:
  explicit VolumePageView(const std::byte* image) : image_(image) {}
  static bool is_volume_page(const std::byte* image) {
    return reinterpret_cast<const VolumePageHeader*>(image)->page_type == kPageTypeVolume;
  }
  [[nodiscard]] const VolumePageHeader& header() const { return *reinterpret_cast<const VolumePageHeader*>(image_); }
  [[nodiscard]] const VolumeNode* nodes() const { return at<VolumeNode>(header().nodes_offset); }
  [[nodiscard]] const Brick* bricks() const { return at<Brick>(header().bricks_offset); }
  [[nodiscard]] const Volume* volumes() const { return at<Volume>(header().nodes_offset); }
  [[nodiscard]] const std::byte* values(const Brick& brick) const {
    return image_ + header().values_offset + brick.values_offset;
  }

 private:
  template <typename T>
  [[nodiscard]] const T* at(std::uint32_t offset) const {
    return reinterpret_cast<const T*>(image_ + offset);
  }
  const std::byte* image_;
};

/// A brick's values as numbers. `step`: of the volume's lattice. Immutable view.
class BrickValues {
 public:
  BrickValues(const VolumePageView& page, const Brick& brick, float step)
      : values_(page.values(brick)), base_(brick.base), bytes_(brick.value_bytes), step_(step) {}
  /// Product exact where |base + q| < 2^24, which the builder sees to.
  [[nodiscard]] float at(int index) const {
    switch (bytes_) {
      case 1:
        return float(base_ + reinterpret_cast<const std::uint8_t*>(values_)[index]) * step_;
      case 2:
        return float(base_ + reinterpret_cast<const std::uint16_t*>(values_)[index]) * step_;
      default:
        return reinterpret_cast<const float*>(values_)[index];
    }
  }

 private:
  const std::byte* values_;
  std::int32_t base_;
  std::uint8_t bytes_;
  float step_;
};

/// What a volume page may refer to.
struct VolumeRules {
  std::uint32_t page_bytes = 0;
  std::uint32_t page_count = 0;
  std::uint64_t geometry_count = 0;
};

/// Checks every count, offset, kind and value of an image, so that rays may use it blindly. What a reference finds in
/// another page is checked when a ray gets there, that bounds hold the values by check_bounds(). Errors: corrupt.
Status validate_volume_image(std::span<const std::byte> image, const VolumeRules& rules);

/// Whether each brick's bounds are those of its values. Errors: corrupt.
Status check_bounds(const std::byte* image, std::span<const Volume> volumes);

/// 2^exponent of a volume's lattice; 1 where it has none.
inline float step_of(const Volume& volume) { return volume.lattice != 0 ? std::ldexp(1.0F, volume.step_exponent) : 1; }

}  // namespace raymill::storage
