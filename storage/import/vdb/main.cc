// raymill-vdb list|read FILE [INDEX]: an OpenVDB file as bricks on stdout (brick_stream.h).
//
// A program of its own, because OpenVDB brings its shared objects and its ways with a damaged file into a process.
// Leaves are loaded when their bricks are cut and dropped after: no brick that comes later in tree order needs them,
// since that order never falls where all three indices rise. Exit code 1 and a sentence on stderr: the file is bad.
#include <openvdb/io/File.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <span>
#include <string>
#include <vector>

#include "storage/import/vdb/brick_stream.h"

namespace {

using namespace raymill::storage;
using openvdb::Coord;
using openvdb::FloatGrid;
using Accessor = FloatGrid::Accessor;

class OutputFailed : public std::exception {};

template <typename T>
void put(std::span<const T> values) {
  if (std::fwrite(values.data(), sizeof(T), values.size(), stdout) != values.size()) {
    throw OutputFailed();
  }
}
template <typename T>
void put_one(const T& value) {
  put(std::span<const T>(&value, 1));
}

// A box of voxels, both ends in it.
struct Box {
  Coord lower, upper;
};

// The box in which the tree holds one value around `at`; none where a leaf is there.
bool tile_at(const Accessor& values, const Coord& at, Box& tile) {
  const int depth = values.getValueDepth(at);
  if (depth == 3) {
    return false;
  }
  const int side = depth == 2 ? 8 : depth == 1 ? 128 : 4096;
  tile.lower = Coord(at.x() & ~(side - 1), at.y() & ~(side - 1), at.z() & ~(side - 1));
  tile.upper = tile.lower.offsetBy(side - 1);
  return true;
}

// Whether tiles of one value fill the box.
bool is_one_value(const Accessor& values, const Box& box, float& value) {
  Box tile;
  if (!tile_at(values, box.lower, tile)) {
    return false;
  }
  value = values.getValue(box.lower);
  Box rest = box;  // what is left beside the tile, cut off axis by axis
  for (int axis = 0; axis < 3; ++axis) {
    if (tile.upper[axis] < rest.upper[axis]) {
      Box beside = rest;
      beside.lower[axis] = tile.upper[axis] + 1;
      float other = 0;
      if (!is_one_value(values, beside, other) || other != value) {
        return false;
      }
      rest.upper[axis] = tile.upper[axis];
    }
  }
  return true;
}

class Cutter {
 public:
  Cutter(FloatGrid& grid, const StreamGrid& info)
      : tree_(grid.tree()), values_(grid.getAccessor()), info_(info), levels_(levels_for(info.cells)) {}

  void run() {
    put_one(StreamHead{.count = 1});
    cut(info_.origin, levels_);
    put_one(StreamRecord{.count = count_});
  }

 private:
  void cut(const Index3& origin, unsigned level) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (origin[axis] >= info_.origin[axis] + info_.cells[axis]) {
        return;
      }
    }
    const Coord lower(origin[0], origin[1], origin[2]);
    float value = 0;
    const bool one_value = is_one_value(values_, {lower, lower.offsetBy(cells_of_level(level))}, value);
    if (one_value && value == info_.background) {
      return;
    }
    if (one_value && level < levels_) {
      put_one(StreamRecord{RecordKind::tile, origin, level, value});
      ++count_;
    } else if (level == 0) {
      cut_brick(origin, lower);
    } else {
      const std::int32_t cells = cells_of_level(level - 1);
      for (int slot = 0; slot < kNodeChildren; ++slot) {
        cut({origin[0] + slot % 4 * cells, origin[1] + slot / 4 % 4 * cells, origin[2] + slot / 16 * cells}, level - 1);
      }
    }
  }

  void cut_brick(const Index3& origin, const Coord& lower) {
    for (int x = 0; x < kBrickCorners; ++x) {
      for (int y = 0; y < kBrickCorners; ++y) {
        for (int z = 0; z < kBrickCorners; ++z) {
          brick_[x + kBrickCorners * (y + kBrickCorners * z)] = values_.getValue(lower.offsetBy(x, y, z));
        }
      }
    }
    put_one(StreamRecord{.kind = RecordKind::brick, .origin = origin});
    put(std::span<const float>(brick_));
    ++count_;
    values_.clear();
    delete tree_.stealNode<FloatGrid::TreeType::LeafNodeType>(lower, info_.background, false);
  }

  FloatGrid::TreeType& tree_;
  Accessor values_;
  const StreamGrid info_;
  const unsigned levels_;
  std::array<float, kBrickValues> brick_{};
  std::uint64_t count_ = 0;
};

std::int32_t rounded_down(std::int32_t index) { return index & ~(kBrickCells - 1); }

GridState state_of(const openvdb::GridBase& grid) {
  if (!grid.isType<FloatGrid>()) {
    return GridState::unsupported_type;
  }
  if (!grid.transform().isLinear()) {
    return GridState::unsupported_transform;
  }
  if (grid.evalActiveVoxelBoundingBox().empty()) {
    return GridState::empty;
  }
  return grid.getGridClass() == openvdb::GRID_LEVEL_SET ? GridState::level_set : GridState::fog;
}

StreamGrid describe(const openvdb::GridBase& grid) {
  StreamGrid info;
  info.state = state_of(grid);
  if (info.state != GridState::fog && info.state != GridState::level_set) {
    return info;
  }
  info.background = static_cast<const FloatGrid&>(grid).background();
  info.active_voxels = grid.activeVoxelCount();
  // A voxel counts in the cells on both its sides.
  const openvdb::CoordBBox box = grid.evalActiveVoxelBoundingBox();
  for (int axis = 0; axis < 3; ++axis) {
    if (box.min()[axis] <= -kMostVolumeIndex / 2 || box.max()[axis] >= kMostVolumeIndex / 2) {
      throw std::runtime_error("grid '" + grid.getName() + "' has voxels beyond index 2^27; move it to its origin");
    }
    info.origin[axis] = rounded_down(box.min()[axis] - 1);
    info.cells[axis] = box.max()[axis] + 1 - info.origin[axis];
  }
  const openvdb::Mat4d map = grid.transform().baseMap()->getAffineMap()->getMat4();  // of row vectors
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      info.world_from_index[row][column] = map(column, row);
    }
  }
  return info;
}

std::vector<openvdb::GridBase::Ptr> open_grids(openvdb::io::File& file) {
  file.setCopyMaxBytes(0);  // leaves stay in the file until they are looked at
  file.open(true);
  std::vector<openvdb::GridBase::Ptr> grids;
  for (auto name = file.beginName(); name != file.endName(); ++name) {
    grids.push_back(file.readGrid(name.gridName()));
  }
  return grids;
}

int run(const std::string& verb, const std::string& path, std::size_t index) {
  openvdb::initialize();
  openvdb::io::File file(path);
  const auto grids = open_grids(file);
  if (verb == "list") {
    put_one(StreamHead{.count = grids.size()});
    for (const auto& grid : grids) {
      StreamGrid info = describe(*grid);
      const std::string name = grid->getName(), type = grid->valueType();
      info.name_bytes = static_cast<std::uint32_t>(name.size());
      info.type_bytes = static_cast<std::uint32_t>(type.size());
      put_one(info);
      put(std::span<const char>(name));
      put(std::span<const char>(type));
    }
  } else {
    const auto grid = openvdb::gridPtrCast<FloatGrid>(grids.at(index));
    Cutter(*grid, describe(*grid)).run();
  }
  return std::fflush(stdout) == 0 ? 0 : 2;
}

}  // namespace

int main(int count, char** words) {
  const std::string verb = count > 1 ? words[1] : "";
  if ((verb != "list" || count != 3) && (verb != "read" || count != 4)) {
    std::fprintf(stderr, "raymill-vdb list FILE | raymill-vdb read FILE INDEX\n");
    return 2;
  }
  try {
    return run(verb, words[2], count == 4 ? std::strtoul(words[3], nullptr, 10) : 0);
  } catch (const OutputFailed&) {
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
