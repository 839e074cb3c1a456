#include "tests/support/volumes.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>

#include "storage/import/vdb/brick_stream.h"
#include "storage/volume/affine.h"
#include "storage/volume/volume_tree.h"

namespace raymill::tests {
namespace {

using namespace storage;

TestVolume cube(int cells, VolumeKind kind, float background) {
  TestVolume volume;
  volume.grid.name = kind == VolumeKind::fog ? "density" : "surface";
  volume.grid.kind = kind;
  volume.grid.cells = {cells, cells, cells};
  volume.grid.background = background;
  volume.grid.active_voxels = 1;
  return volume;
}

template <typename T>
void append(std::string& text, const T& value) {
  text.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void write_text(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  ASSERT_TRUE(file.flush().good());
}

std::string list_stream(const TestVolume& volume) {
  const GridInfo& grid = volume.grid;
  const std::string type = "float";
  std::string text;
  append(text, StreamHead{.count = 1});
  append(text, StreamGrid{grid.kind == VolumeKind::fog ? GridState::fog : GridState::level_set,
                          static_cast<std::uint32_t>(grid.name.size()), static_cast<std::uint32_t>(type.size()),
                          grid.background, grid.origin, grid.cells, grid.active_voxels, grid.world_from_index});
  return text + grid.name + type;
}

std::string brick_stream(const TestVolume& volume) {
  std::string text;
  append(text, StreamHead{.count = 1});
  std::uint64_t count = 0;
  for_each_brick(volume, [&](const Index3& origin, const std::vector<float>& values) {
    append(text, StreamRecord{.kind = RecordKind::brick, .origin = origin});
    text.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
    ++count;
    return Status();
  });
  append(text, StreamRecord{.count = count});
  return text;
}

}  // namespace

TestVolume wavy_fog(int cells) {
  TestVolume volume = cube(cells, VolumeKind::fog, 0);
  volume.grid.origin = {-16, 0, 8};
  volume.grid.world_from_index = {{{0.1, 0.02, 0, 1}, {0, 0.1, 0, 2}, {0.01, 0, 0.15, 3}}};
  volume.value = [cells, origin = volume.grid.origin](int x, int y, int z) {
    x -= origin[0], y -= origin[1], z -= origin[2];
    if (x <= 0 || y <= 0 || z <= 0 || x >= cells || y >= cells || z >= cells) {
      return 0.0F;
    }
    const double wave = std::sin(x * 0.31) + std::sin(y * 0.17 + 1) + std::sin(z * 0.23 + 2);
    return wave > 0.3 ? static_cast<float>(wave * 0.3) : 0.0F;
  };
  return volume;
}

TestVolume ball(int cells, const Point3& centre, double radius) {
  const double cell = 1.0 / cells;
  TestVolume volume = cube(cells, VolumeKind::level_set, static_cast<float>(3 * cell));
  volume.grid.world_from_index = {{{cell, 0, 0, 0}, {0, cell, 0, 0}, {0, 0, cell, 0}}};
  volume.value = [=](int x, int y, int z) {
    const double distance = std::sqrt(std::pow(x * cell - centre[0], 2) + std::pow(y * cell - centre[1], 2) +
                                      std::pow(z * cell - centre[2], 2)) -
                            radius;
    return static_cast<float>(std::clamp(distance, -3 * cell, 3 * cell));
  };
  return volume;
}

void for_each_brick(const TestVolume& volume,
                    const std::function<Status(const Index3&, const std::vector<float>&)>& use) {
  const GridInfo& grid = volume.grid;
  const std::function<void(const Index3&, unsigned)> visit = [&](const Index3& at, unsigned level) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (at[axis] >= grid.origin[axis] + grid.cells[axis]) {
        return;
      }
    }
    if (level == 0) {
      std::vector<float> values;
      for (int i = 0; i < kBrickValues; ++i) {
        values.push_back(volume.value(at[0] + i % 9, at[1] + i / 9 % 9, at[2] + i / 81));
      }
      const Status status = use(at, values);
      ASSERT_TRUE(status.ok()) << status.message();
      return;
    }
    const std::int32_t cells = cells_of_level(level - 1);
    for (int slot = 0; slot < kNodeChildren; ++slot) {
      visit({at[0] + slot % 4 * cells, at[1] + slot / 4 % 4 * cells, at[2] + slot / 16 * cells}, level - 1);
    }
  };
  visit(grid.origin, levels_for(grid.cells));
}

BuiltVolume build_volume(const TestVolume& volume, std::uint32_t page_bytes,
                         std::optional<std::int32_t> step_exponent) {
  BuiltVolume built;
  VolumeTree::Config config{.page_bytes = page_bytes, .step_exponent = step_exponent, .write = {}};
  config.write = [&](std::uint32_t page, std::span<const std::byte> image) {
    built.pages.resize(std::max<std::size_t>(built.pages.size(), page + 1));
    built.pages[page].assign(image.begin(), image.end());
    return Status();
  };
  VolumeTree tree(volume.grid, std::move(config));
  for_each_brick(volume, [&](const Index3& origin, const std::vector<float>& values) {
    return tree.add_brick(origin, std::span<const float, kBrickValues>(values.data(), kBrickValues));
  });
  const auto entry = tree.finish();
  EXPECT_TRUE(entry.ok()) << entry.status().message();
  built.volume = *entry;
  return built;
}

std::string write_volume_file(const TempFolder& folder, const std::string& name, const TestVolume& volume,
                              std::size_t cut_bytes) {
  const std::string path = folder / name, reader = folder / "reader.sh";
  std::string bricks = brick_stream(volume);
  bricks.resize(bricks.size() - std::min(bricks.size(), cut_bytes));
  write_text(path, " BDV");
  write_text(path + ".list", list_stream(volume));
  write_text(path + ".read", bricks);
  write_text(reader, "#!/bin/sh\nexec cat \"$2.$1\"\n");
  EXPECT_EQ(::chmod(reader.c_str(), 0755), 0);
  EXPECT_EQ(::setenv("RAYMILL_VDB_READER", reader.c_str(), 1), 0);
  return path;
}

namespace {

struct IndexRay {
  Point3 org, dir;
};
IndexRay in_index_space(const TestVolume& volume, const Ray& ray) {
  const Affine map = *inverse_of(volume.grid.world_from_index);
  return {map_point(map, {ray.org[0], ray.org[1], ray.org[2]}),
          map_direction(map, {ray.dir[0], ray.dir[1], ray.dir[2]})};
}

}  // namespace

Way way_through(const TestVolume& volume, const Ray& ray) {
  const auto [org, dir] = in_index_space(volume, ray);
  Way way{ray.tnear, ray.tfar};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double lower = volume.grid.origin[axis], upper = lower + volume.grid.cells[axis];
    if (dir[axis] == 0) {
      way.end = org[axis] >= lower && org[axis] < upper ? way.end : way.begin;
      continue;
    }
    const double first = (lower - org[axis]) / dir[axis], last = (upper - org[axis]) / dir[axis];
    way.begin = std::max(way.begin, std::min(first, last));
    way.end = std::min(way.end, std::max(first, last));
  }
  return way;
}

double field_at(const TestVolume& volume, const Ray& ray, double t) {
  const auto [org, dir] = in_index_space(volume, ray);
  std::array<int, 3> cell{};
  Point3 part{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double at = org[axis] + dir[axis] * t;
    cell[axis] = static_cast<int>(std::floor(at));
    part[axis] = at - cell[axis];
  }
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double weight = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      weight *= (corner >> axis & 1) != 0 ? part[axis] : 1 - part[axis];
    }
    sum += weight * volume.value(cell[0] + (corner & 1), cell[1] + (corner >> 1 & 1), cell[2] + (corner >> 2));
  }
  return sum;
}

double dense_depth(const TestVolume& volume, const Ray& ray, int steps) {
  const Way way = way_through(volume, ray);
  if (!(way.begin < way.end)) {
    return 0;
  }
  double sum = 0;
  for (int i = 0; i < steps; ++i) {
    sum += field_at(volume, ray, way.begin + (i + 0.5) * (way.end - way.begin) / steps);
  }
  const double length =
      std::sqrt(double(ray.dir[0]) * ray.dir[0] + double(ray.dir[1]) * ray.dir[1] + double(ray.dir[2]) * ray.dir[2]);
  return sum * (way.end - way.begin) / steps * length;
}

std::vector<Ray> rays_through(const TestVolume& volume, std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  const auto point = [&](double margin) {
    Point3 p{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      p[axis] = volume.grid.origin[axis] + volume.grid.cells[axis] * (unit(random) * (1 + 2 * margin) - margin);
    }
    return p;
  };
  std::vector<Ray> rays(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Point3 from = point(2), to = point(0);
    Point3 along{to[0] - from[0], to[1] - from[1], to[2] - from[2]};
    if (i % 5 == 0) {
      const double kept = along[i / 5 % 3];
      along = {};
      along[i / 5 % 3] = kept;
    }
    const Point3 org = map_point(volume.grid.world_from_index, {to[0] - along[0], to[1] - along[1], to[2] - along[2]});
    const Point3 dir = map_direction(volume.grid.world_from_index, along);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      rays[i].org[axis] = static_cast<float>(org[axis]);
      rays[i].dir[axis] = static_cast<float>(dir[axis]);
    }
    rays[i].tnear = i % 4 == 1 ? 0.4F : 0;
    rays[i].tfar = i % 3 == 1 ? 1.1F : std::numeric_limits<float>::infinity();
  }
  return rays;
}

}  // namespace raymill::tests
