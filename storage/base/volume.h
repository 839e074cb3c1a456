// What the folders share about volumes: kinds, the sizes of bricks and nodes, grids as they are imported. Plain values.
//
// A volume is a field of values at the integer points of its index space, trilinear between them. It is cut into
// bricks of 8 x 8 x 8 cells; a brick holds the values of its cells' corners, so a cell needs no other brick. Nodes of
// 4 x 4 x 4 children stand above them: level 0 is a brick, a node of level L covers 8 * 4^L cells along each axis.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "storage/base/status.h"

namespace raymill::storage {

enum class VolumeKind : std::uint8_t {
  fog = 0,        ///< density: what a ray loses along its way
  level_set = 1,  ///< signed distance: a surface where it is 0, negative inside
};

constexpr int kBrickCells = 8;                                               ///< along an axis
constexpr int kBrickCorners = kBrickCells + 1;                               ///< values along an axis
constexpr int kBrickValues = kBrickCorners * kBrickCorners * kBrickCorners;  ///< x fastest, then y, then z
constexpr int kNodeSide = 4;                                                 ///< children along an axis
constexpr int kNodeChildren = kNodeSide * kNodeSide * kNodeSide;             ///< slot = x + 4 (y + 4 z)
/// Of the root. Its node covers 8 * 4^12 = 2^27 cells along an axis.
constexpr unsigned kMostVolumeLevels = 12;
/// Largest magnitude of an index: sums and differences of a few stay in 32 bits.
constexpr std::int32_t kMostVolumeIndex = std::int32_t{1} << 28;

using Index3 = std::array<std::int32_t, 3>;

/// Cells along an axis under a node of this level; 0: a brick.
constexpr std::int32_t cells_of_level(unsigned level) { return kBrickCells << (2 * level); }
static_assert(cells_of_level(kMostVolumeLevels) == 1 << 27);

/// The least level, at least 1, whose node covers so many cells along each axis; more than kMostVolumeLevels: none
/// does.
constexpr unsigned levels_for(const Index3& cells) {
  unsigned level = 1;
  while (level <= kMostVolumeLevels &&
         (cells[0] > cells_of_level(level) || cells[1] > cells_of_level(level) || cells[2] > cells_of_level(level))) {
    ++level;
  }
  return level;
}

/// An affine map: rows of a 3 x 4 matrix, the last column is added.
using Affine = std::array<std::array<double, 4>, 3>;

/// A grid as it is imported.
struct GridInfo {
  std::string name;
  VolumeKind kind = VolumeKind::fog;
  Index3 origin{};  ///< least corner of the cells that hold anything
  Index3 cells{};   ///< along each axis
  float background = 0;
  std::uint64_t active_voxels = 0;
  Affine world_from_index{};
};

/// Takes a grid's bricks and tiles in the tree's order: depth first, slots rising. What does not come is background.
/// Called from one thread; an error ends the import with that error.
class BrickSink {
 public:
  virtual ~BrickSink() = default;
  virtual Status add_brick(const Index3& origin, std::span<const float, kBrickValues> values) = 0;
  /// One value in all cells of a child of a node of `level` + 1, and at their corners.
  virtual Status add_tile(const Index3& origin, unsigned level, float value) = 0;
};

}  // namespace raymill::storage
