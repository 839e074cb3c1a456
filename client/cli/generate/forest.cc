#include <cmath>
#include <numbers>
#include <string>

#include "client/cli/generate/generate.h"
#include "client/cli/random.h"

namespace raymill::client {

namespace {

constexpr float kPlot = 10;  // side of a square with its own trees and grass, metres
constexpr std::uint32_t kTrees = 4;
constexpr std::uint32_t kBranches = 40;
constexpr std::uint32_t kLeaves = 36;  // on a branch
constexpr std::uint32_t kTrunkRings = 7;
constexpr std::uint32_t kTrunkSides = 5;
constexpr std::uint32_t kGrass = 3000;

constexpr std::uint64_t kTrunkTriangles = kTrunkRings * kTrunkSides * 2;
constexpr std::uint64_t kBranchTriangles = 3 + kLeaves;  // a three-sided spike and thin single triangles
constexpr std::uint64_t kTreeTriangles = kTrunkTriangles + kBranches * kBranchTriangles;
constexpr std::uint64_t kPlotTriangles = kTrees * kTreeTriangles + kGrass;

constexpr float kTurn = 2 * std::numbers::pi_v<float>;

Point along(const Point& p, const Point& d, float s) { return {p[0] + d[0] * s, p[1] + d[1] * s, p[2] + d[2] * s}; }

Point direction(Random& random, float low_y, float high_y) {
  const float y = random.range(low_y, high_y), angle = random.range(0, kTurn);
  const float r = std::sqrt(std::max(0.0F, 1 - y * y));
  return {r * std::cos(angle), y, r * std::sin(angle)};
}

void add_trunk(SceneWriter& scene, const Point& foot, float height, float radius) {
  std::uint32_t first = 0;
  for (std::uint32_t ring = 0; ring <= kTrunkRings; ++ring) {
    const float s = static_cast<float>(ring) / kTrunkRings;
    for (std::uint32_t i = 0; i < kTrunkSides; ++i) {
      const float angle = kTurn * static_cast<float>(i) / kTrunkSides, r = radius * (1.05F - s);
      const std::uint32_t v =
          scene.vertex({foot[0] + r * std::cos(angle), foot[1] + s * height, foot[2] + r * std::sin(angle)});
      first = ring == 0 && i == 0 ? v : first;
    }
  }
  for (std::uint32_t ring = 0; ring < kTrunkRings; ++ring) {
    for (std::uint32_t i = 0; i < kTrunkSides; ++i) {
      const std::uint32_t a = first + ring * kTrunkSides + i;
      const std::uint32_t b = first + ring * kTrunkSides + (i + 1) % kTrunkSides;
      scene.quad(a, a + kTrunkSides, b + kTrunkSides, b);
    }
  }
}

void add_branch(SceneWriter& scene, Random& random, const Point& from, float length) {
  const Point d = direction(random, -0.1F, 0.7F);
  const Point tip = along(from, d, length);
  const float r = 0.02F * length;
  const std::uint32_t base[] = {scene.vertex({from[0], from[1] + r, from[2]}),
                                scene.vertex({from[0] - r * d[2], from[1] - r, from[2] + r * d[0]}),
                                scene.vertex({from[0] + r * d[2], from[1] - r, from[2] - r * d[0]})};
  const std::uint32_t end = scene.vertex(tip);
  for (int i = 0; i < 3; ++i) {
    scene.triangle(base[i], base[(i + 1) % 3], end);
  }
  for (std::uint32_t i = 0; i < kLeaves; ++i) {
    const Point at = along(from, d, length * random.range(0.25F, 1.05F));
    const Point leaf = direction(random, -0.8F, 0.6F);
    const Point side = direction(random, -0.3F, 0.3F);
    const float leaf_length = random.range(0.2F, 0.5F), width = leaf_length * random.range(0.06F, 0.2F);
    scene.facet(along(at, side, -width), along(at, side, width), along(at, leaf, leaf_length));
  }
}

void add_tree(SceneWriter& scene, Random& random, float x, float z, const HeightField& ground) {
  const Point foot{x, ground(x, z) - 0.3F, z};
  const float height = random.range(4, 11);
  add_trunk(scene, foot, height, height * 0.022F);
  for (std::uint32_t i = 0; i < kBranches; ++i) {
    const float s = 0.3F + 0.7F * static_cast<float>(i) / kBranches;
    const Point from{foot[0], foot[1] + s * height, foot[2]};
    add_branch(scene, random, from, height * (1.08F - s) * random.range(0.3F, 0.5F));
  }
}

void add_grass(SceneWriter& scene, Random& random, float x, float z, const HeightField& ground) {
  const float y = ground(x, z) - 0.02F, angle = random.range(0, kTurn);
  const float w = random.range(0.003F, 0.008F), height = random.range(0.15F, 0.5F);
  const float dx = w * std::cos(angle), dz = w * std::sin(angle), lean = height * random.range(-0.4F, 0.4F);
  scene.facet({x - dx, y, z - dz}, {x + dx, y, z + dz},
              {x + lean * std::sin(angle), y + height, z + lean * std::cos(angle)});
}

std::uint64_t plots(std::uint64_t triangles) {
  return static_cast<std::uint64_t>(std::sqrt(static_cast<double>(triangles) / kPlotTriangles));
}

}  // namespace

static_assert(kWoodTriangles == 3 * kTreeTriangles);
void add_wood(std::uint64_t seed, SceneWriter& scene) {
  Random random(seed);
  const HeightField flat = [](float, float) { return 0.0F; };
  for (int i = 0; i < 3; ++i) {
    const float x = random.range(-2, 2), z = random.range(-2, 2);
    add_tree(scene, random, x, z, flat);
  }
}

float forest_side(std::uint64_t triangles, std::uint64_t) {
  return static_cast<float>(std::max<std::uint64_t>(1, plots(triangles))) * kPlot;
}

Status add_forest(std::uint64_t triangles, std::uint64_t seed, float x, float z, const HeightField& ground,
                  SceneWriter& scene, float& side) {
  side = forest_side(triangles, seed);
  const std::uint64_t n = std::max<std::uint64_t>(1, plots(triangles));
  const std::uint64_t end = scene.triangles() + triangles;
  for (std::uint64_t plot = 0; plot < n * n; ++plot) {
    Random random(mix(seed, plot));
    const float x0 = x + static_cast<float>(plot % n) * kPlot - side / 2;
    const float z0 = z + static_cast<float>(plot / n) * kPlot - side / 2;
    for (std::uint32_t i = 0; i < kTrees && scene.triangles() + kTreeTriangles <= end; ++i) {
      const float tree_x = x0 + random.range(0, kPlot), tree_z = z0 + random.range(0, kPlot);
      add_tree(scene, random, tree_x, tree_z, ground);
    }
    for (std::uint32_t i = 0; i < kGrass && scene.triangles() < end; ++i) {
      const float grass_x = x0 + random.range(0, kPlot), grass_z = z0 + random.range(0, kPlot);
      add_grass(scene, random, grass_x, grass_z, ground);
    }
    RAYMILL_RETURN_IF_ERROR(scene.end_object("forest-" + std::to_string(plot)));
  }
  return scene.end_patch("forest");
}

}  // namespace raymill::client
