#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "client/cli/generate/generate.h"
#include "client/cli/random.h"

namespace raymill::client {

namespace {

constexpr float kPitch = 100;                   // from block to block, metres
constexpr float kStreet = 18;                   // width
constexpr float kFloor = 3.2F;                  // height of a storey
constexpr float kBay = 3.0F;                    // least width of a window's bay
constexpr float kFoundation = 0.5F;             // below the ground, so that walls and ground meet without a gap
constexpr float kReveal = 0.18F;                // depth of a window in its wall
constexpr std::uint64_t kWindowTriangles = 18;  // frame 8, reveal 8, pane 2
constexpr std::uint64_t kBoxTriangles = 10;     // four walls and a roof
constexpr std::uint64_t kSampleBlocks = 64;     // looked at to estimate a block

struct Building {
  float x0, z0, x1, z1;
  std::uint32_t floors;
  bool windows;

  [[nodiscard]] static std::uint32_t bays(float length) {
    return std::max(1U, static_cast<std::uint32_t>(length / kBay));
  }
  [[nodiscard]] std::uint64_t triangles() const {
    const std::uint64_t wall_bays = 2 * (bays(x1 - x0) + bays(z1 - z0));
    // Walls, the roof's quad, and the box on it.
    return windows ? wall_bays * floors * kWindowTriangles + 2 + kBoxTriangles : kBoxTriangles;
  }
};

// The buildings of a block; `centre` in [0, 1] is how near it is to the middle of the city.
std::vector<Building> block(std::uint64_t seed, std::uint64_t index, float centre, bool windows) {
  Random random(mix(seed, index));
  const float size = kPitch - kStreet;
  const std::uint32_t nx = random.whole(2, 4), nz = random.whole(2, 4);
  std::vector<Building> buildings;
  for (std::uint32_t iz = 0; iz < nz; ++iz) {
    for (std::uint32_t ix = 0; ix < nx; ++ix) {
      const bool yard = random.unit() < 0.12F;
      const float gap = random.range(0.5F, 3.0F);
      const float spread = random.unit() * random.unit();
      const auto floors = static_cast<std::uint32_t>(3 + 9 * spread + 32 * centre * centre * random.unit());
      const float w = size / static_cast<float>(nx), d = size / static_cast<float>(nz);
      const float x = static_cast<float>(ix) * w - size / 2, z = static_cast<float>(iz) * d - size / 2;
      if (!yard) {
        buildings.push_back({x + gap, z + gap, x + w - gap, z + d - gap, floors, windows});
      }
    }
  }
  return buildings;
}

// A wall that stands on `o`, runs along `u` (unit) for `length` and looks along `n` (unit), with a grid of windows.
void add_wall(SceneWriter& scene, const Point& o, const Point& u, const Point& n, float length, std::uint32_t floors) {
  const std::uint32_t bays = Building::bays(length);
  const float bay = length / static_cast<float>(bays);
  const auto at = [&](float along, float up, float in) {
    return scene.vertex({o[0] + u[0] * along - n[0] * in, o[1] + up, o[2] + u[2] * along - n[2] * in});
  };
  for (std::uint32_t floor = 0; floor < floors; ++floor) {
    // The lowest storey reaches below the ground.
    const float y0 = floor == 0 ? -kFoundation : static_cast<float>(floor) * kFloor;
    const float y1 = static_cast<float>(floor + 1) * kFloor;
    const float sill = y1 - kFloor * 0.72F, lintel = y1 - kFloor * 0.15F;
    for (std::uint32_t i = 0; i < bays; ++i) {
      const float a0 = static_cast<float>(i) * bay, a1 = static_cast<float>(i + 1) * bay;
      const float b0 = a0 + bay * 0.22F, b1 = a1 - bay * 0.22F;
      const std::uint32_t outer[] = {at(a0, y0, 0), at(a1, y0, 0), at(a1, y1, 0), at(a0, y1, 0)};
      const std::uint32_t rim[] = {at(b0, sill, 0), at(b1, sill, 0), at(b1, lintel, 0), at(b0, lintel, 0)};
      const std::uint32_t pane[] = {at(b0, sill, kReveal), at(b1, sill, kReveal), at(b1, lintel, kReveal),
                                    at(b0, lintel, kReveal)};
      for (int k = 0; k < 4; ++k) {
        const int next = (k + 1) % 4;
        scene.quad(outer[k], outer[next], rim[next], rim[k]);
        scene.quad(rim[k], rim[next], pane[next], pane[k]);
      }
      scene.quad(pane[0], pane[1], pane[2], pane[3]);
    }
  }
}

void add_box(SceneWriter& scene, float x0, float y0, float z0, float x1, float y1, float z1) {
  std::uint32_t v[8];
  for (int i = 0; i < 8; ++i) {
    v[i] = scene.vertex({(i & 1) != 0 ? x1 : x0, (i & 2) != 0 ? y1 : y0, (i & 4) != 0 ? z1 : z0});
  }
  scene.quad(v[0], v[2], v[3], v[1]);
  scene.quad(v[4], v[5], v[7], v[6]);
  scene.quad(v[0], v[4], v[6], v[2]);
  scene.quad(v[1], v[3], v[7], v[5]);
  scene.quad(v[2], v[6], v[7], v[3]);
}

void add_building(SceneWriter& scene, const Building& b, float x, float z) {
  const float x0 = x + b.x0, x1 = x + b.x1, z0 = z + b.z0, z1 = z + b.z1;
  const float top = static_cast<float>(b.floors) * kFloor;
  if (!b.windows) {
    add_box(scene, x0, -kFoundation, z0, x1, top, z1);
    return;
  }
  add_wall(scene, {x0, 0, z1}, {1, 0, 0}, {0, 0, 1}, x1 - x0, b.floors);
  add_wall(scene, {x1, 0, z0}, {-1, 0, 0}, {0, 0, -1}, x1 - x0, b.floors);
  add_wall(scene, {x1, 0, z1}, {0, 0, -1}, {1, 0, 0}, z1 - z0, b.floors);
  add_wall(scene, {x0, 0, z0}, {0, 0, 1}, {-1, 0, 0}, z1 - z0, b.floors);
  const std::uint32_t roof[] = {scene.vertex({x0, top, z0}), scene.vertex({x0, top, z1}), scene.vertex({x1, top, z1}),
                                scene.vertex({x1, top, z0})};
  scene.quad(roof[0], roof[1], roof[2], roof[3]);
  const float cx = (x0 + x1) / 2, cz = (z0 + z1) / 2, quarter = std::min(x1 - x0, z1 - z0) / 6;
  add_box(scene, cx - quarter, top - 0.2F, cz - quarter, cx + quarter, top + 2.4F, cz + quarter);
}

std::uint64_t triangles_of(const std::vector<Building>& buildings) {
  std::uint64_t sum = 0;
  for (const Building& building : buildings) {
    sum += building.triangles();
  }
  return sum;
}

// Nearness of block (ix, iz) of n x n to the middle.
float nearness(std::uint64_t ix, std::uint64_t iz, std::uint64_t n) {
  const float half = static_cast<float>(n) / 2;
  const float dx = (static_cast<float>(ix) + 0.5F - half) / half, dz = (static_cast<float>(iz) + 0.5F - half) / half;
  return std::max(0.0F, 1 - std::sqrt(dx * dx + dz * dz));
}

struct Plan {
  std::uint64_t blocks = 0;  // along a side
  bool windows = false;
};

// The largest square of blocks that the triangles are expected to fill, with windows where at least a few blocks of
// them fit.
Plan plan(std::uint64_t triangles, std::uint64_t seed) {
  for (const bool windows : {true, false}) {
    std::uint64_t sampled = 0;
    for (std::uint64_t i = 0; i < kSampleBlocks; ++i) {
      sampled += triangles_of(block(seed, i, nearness(i % 8, i / 8, 8), windows));
    }
    const double average = static_cast<double>(sampled) / kSampleBlocks;
    const auto side = static_cast<std::uint64_t>(std::sqrt(static_cast<double>(triangles) / average));
    if (side >= 3 || (!windows && side > 0)) {
      return {side, windows};
    }
  }
  return {};
}

}  // namespace

float city_side(std::uint64_t triangles, std::uint64_t seed) {
  return static_cast<float>(plan(triangles, seed).blocks) * kPitch;
}

Status add_city(std::uint64_t triangles, std::uint64_t seed, float x, float z, SceneWriter& scene, float& side) {
  const auto [n, windows] = plan(triangles, seed);
  side = static_cast<float>(n) * kPitch;
  const std::uint64_t end = scene.triangles() + triangles;
  for (std::uint64_t i = 0; i < n * n; ++i) {
    const std::uint64_t ix = i % n, iz = i / n;
    const float block_x = x + (static_cast<float>(ix) + 0.5F) * kPitch - side / 2;
    const float block_z = z + (static_cast<float>(iz) + 0.5F) * kPitch - side / 2;
    for (const Building& building : block(seed, i, nearness(ix, iz, n), windows)) {
      if (scene.triangles() + building.triangles() <= end) {
        add_building(scene, building, block_x, block_z);
      }
    }
    RAYMILL_RETURN_IF_ERROR(scene.end_object("city-" + std::to_string(i)));
  }
  return scene.end_patch("city");
}

}  // namespace raymill::client
