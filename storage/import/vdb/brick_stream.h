// What raymill-vdb writes to its stdout and the import reads: two streams, little-endian, without gaps.
//
//   raymill-vdb list FILE          StreamHead | count x (StreamGrid | name | type)
//   raymill-vdb read FILE INDEX    StreamHead | records: StreamRecord, a brick's with kBrickValues float32 behind it
//
// Records come in the tree's order (storage/base/volume.h); the last one says `end` and how many came before it, so a
// stream that was cut is known. Plain data.
#pragma once

#include <cstdint>
#include <type_traits>

#include "storage/base/volume.h"

namespace raymill::storage {

constexpr std::uint64_t kStreamMagic = 0x31304244564D52ULL;  // "RMVDB01"

enum class GridState : std::uint32_t {
  fog = 0,
  level_set = 1,
  unsupported_type = 2,       ///< values are not float32
  empty = 3,                  ///< no active voxel
  unsupported_transform = 4,  ///< not linear
};

struct StreamHead {
  std::uint64_t magic = kStreamMagic;
  std::uint64_t count = 0;  ///< of grids; read: 1
};
static_assert(sizeof(StreamHead) == 16);

struct StreamGrid {
  GridState state = GridState::fog;
  std::uint32_t name_bytes = 0;
  std::uint32_t type_bytes = 0;
  float background = 0;
  Index3 origin{};
  Index3 cells{};
  std::uint64_t active_voxels = 0;
  Affine world_from_index{};
};
static_assert(sizeof(StreamGrid) == 144 && std::is_trivially_copyable_v<StreamGrid>);

constexpr std::uint32_t kMostGridNameBytes = 1 << 16;
constexpr std::uint32_t kMostGrids = 1 << 16;

enum class RecordKind : std::uint32_t { brick = 1, tile = 2, end = 3 };

struct StreamRecord {
  RecordKind kind = RecordKind::end;
  Index3 origin{};
  std::uint32_t level = 0;  ///< of a tile
  float value = 0;          ///< of a tile
  std::uint64_t count = 0;  ///< end: of records before it
};
static_assert(sizeof(StreamRecord) == 32 && std::is_trivially_copyable_v<StreamRecord>);

}  // namespace raymill::storage
