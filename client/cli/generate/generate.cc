#include "client/cli/generate/generate.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "client/cli/generate/noise.h"
#include "client/cli/random.h"
#include "storage/base/quotes.h"

namespace raymill::client {

namespace {

constexpr float kTerrainSide = 2000;  // metres, whatever the triangles: more of them show finer detail
constexpr float kTerrainHeight = 420;
constexpr double kFieldOfView = 0.75;  // radians

// Octaves down to about two triangles' sides, from a wavelength of `longest`.
int octaves_for(std::uint64_t triangles, float side, float longest) {
  const double cell = side / std::sqrt(static_cast<double>(triangles) / 2 + 1);
  return std::clamp(static_cast<int>(std::log2(longest / (2 * cell))) + 1, 1, 16);
}

float mountains(std::uint64_t seed, float x, float z, int octaves) {
  const float scale = 1 / 900.0F;
  const float u = x * scale, v = z * scale;
  // Bending the plane first keeps the ridges from following the lattice.
  const float du = fractal(seed + 101, u, v, 3), dv = fractal(seed + 202, u, v, 3);
  return kTerrainHeight * (ridged(seed, u + 0.25F * du, v + 0.25F * dv, octaves) - 0.35F);
}

Status view(SceneWriter& scene, const std::string& name, const Vector& from, const Vector& to) {
  RAYMILL_ASSIGN_OR_RETURN(const Camera camera, look_at(from, to, kFieldOfView));
  scene.add_camera(name, camera);
  return {};
}

Status terrain(std::uint64_t triangles, std::uint64_t seed, SceneWriter& scene) {
  const int octaves = octaves_for(triangles, kTerrainSide, 900);
  const HeightField height = [=](float x, float z) { return mountains(seed, x, z, octaves); };
  RAYMILL_RETURN_IF_ERROR(view(scene, "overview", {-850, 620, 1150}, {60, -20, -60}));
  const float eye = height(-300, 900) + 60;
  RAYMILL_RETURN_IF_ERROR(view(scene, "hiker", {-300, eye, 900}, {0, eye - 40, 0}));
  return add_ground(triangles, kTerrainSide, height, scene);
}

Status city(std::uint64_t triangles, std::uint64_t seed, SceneWriter& scene) {
  const std::uint64_t buildings = triangles - triangles / 20;
  float side = 0;
  RAYMILL_RETURN_IF_ERROR(add_city(buildings, seed, 0, 0, scene, side));
  const double s = std::max(side, 100.0F);
  RAYMILL_RETURN_IF_ERROR(view(scene, "overview", {-0.42 * s, 0.22 * s + 60, 0.72 * s}, {0.02 * s, 0, 0}));
  // Down the middle of a street, which runs between two blocks.
  const double street = std::fmod(s / 200, 1.0) == 0.0 ? 0 : 50;
  RAYMILL_RETURN_IF_ERROR(view(scene, "street", {street, 9, 0.5 * s - 5}, {street, 16, 0}));
  const HeightField paving = [=](float x, float z) { return 0.03F * fractal(seed + 7, x / 4, z / 4, 3); };
  return add_ground(triangles - scene.triangles(), static_cast<float>(s) + 60, paving, scene);
}

Status forest(std::uint64_t triangles, std::uint64_t seed, SceneWriter& scene) {
  const std::uint64_t plants = triangles - triangles / 10;
  const HeightField height = [=](float x, float z) { return 3 * fractal(seed + 7, x / 40, z / 40, 4); };
  float side = 0;
  RAYMILL_RETURN_IF_ERROR(add_forest(plants, seed, 0, 0, height, scene, side));
  const double s = side;
  RAYMILL_RETURN_IF_ERROR(view(scene, "overview", {-0.28 * s, 0.08 * s + 8, 0.58 * s}, {0, 0.02 * s, 0}));
  const float eye = height(0, side / 2) + 1.7F;
  RAYMILL_RETURN_IF_ERROR(view(scene, "walker", {0, eye, 0.5 * s}, {0.05 * s, eye + 1, 0}));
  return add_ground(triangles - scene.triangles(), side + 10, height, scene);
}

Status mixed(std::uint64_t triangles, std::uint64_t seed, SceneWriter& scene) {
  const std::uint64_t city_triangles = triangles * 2 / 5, forest_triangles = triangles / 5;
  const float city_length = std::max(100.0F, city_side(city_triangles, seed));
  const float forest_length = forest_side(forest_triangles, seed + 1);
  const float forest_x = (city_length + forest_length) / 2 + 40;
  const float land = 2.2F * (city_length + forest_length);
  const float scale = land / (2 * kTerrainSide);  // mountains grow with the land
  const int octaves = octaves_for(triangles - city_triangles - forest_triangles, land, 900 * scale);
  // The plain that holds the city and the forest rises to mountains at its edge.
  const float middle = forest_length / 2, reach = (city_length + forest_length) * 0.62F;
  const HeightField height = [=](float x, float z) {
    const float outside = std::max(std::abs(x - middle), std::abs(z)) - reach;
    const float rise = std::clamp(outside / (0.3F * reach), 0.0F, 1.0F);
    const float hill = std::max(0.0F, mountains(seed, x / scale, z / scale, octaves) + 0.25F * kTerrainHeight) * scale;
    return rise * rise * (3 - 2 * rise) * hill + 0.02F * noise(seed + 7, x / 3, z / 3);
  };
  float side = 0;
  RAYMILL_RETURN_IF_ERROR(add_city(city_triangles, seed, 0, 0, scene, side));
  RAYMILL_RETURN_IF_ERROR(add_forest(forest_triangles, seed + 1, forest_x, 0, height, scene, side));
  const double s = city_length + forest_length;
  RAYMILL_RETURN_IF_ERROR(view(scene, "overview", {middle - 0.2 * s, 0.2 * s + 20, 0.56 * s}, {middle, 0.02 * s, 0}));
  return add_ground(triangles - scene.triangles(), land, height, scene);
}

// Each kind of tree stands in every so many-th place of a jittered grid: turned, leaning a little, of its own height
// and girth, every eighth mirrored.
Status woods(std::uint64_t triangles, std::uint64_t seed, unsigned meshes, SceneWriter& scene) {
  constexpr float kSpacing = 9;
  const std::uint64_t ground = triangles / 1000 + 2;
  const std::uint64_t count = (triangles - std::min(triangles, ground)) / kWoodTriangles;
  if (count < meshes) {
    return {ErrorCode::invalid_argument, "woods of " + std::to_string(meshes) + " meshes need at least " +
                                             std::to_string((meshes + 1) * (kWoodTriangles + 10)) +
                                             " triangles; give more or fewer --meshes"};
  }
  const auto across = static_cast<std::uint64_t>(std::ceil(std::sqrt(static_cast<double>(count))));
  const float side = static_cast<float>(across) * kSpacing;
  const HeightField height = [=](float x, float z) { return 6 * fractal(seed + 7, x / 120, z / 120, 5); };
  const double s = side;
  RAYMILL_RETURN_IF_ERROR(view(scene, "overview", {-0.28 * s, 0.05 * s + 12, 0.58 * s}, {0, 0, 0}));
  const float eye = height(0, side / 2) + 1.7F;
  RAYMILL_RETURN_IF_ERROR(view(scene, "walker", {0, eye, 0.5 * s}, {0.05 * s, eye + 1, 0}));
  std::vector<Stand> stands;
  for (unsigned mesh = 0; mesh < meshes; ++mesh) {
    add_wood(mix(seed, mesh), scene);
    stands.clear();
    for (std::uint64_t at = mesh; at < count; at += meshes) {
      Random random(mix(seed + 1, at));
      Stand& stand = stands.emplace_back();
      const float x = (static_cast<float>(at % across) + random.range(0, 0.8F)) * kSpacing - side / 2;
      const float z = (static_cast<float>(at / across) + random.range(0, 0.8F)) * kSpacing - side / 2;
      stand.translation = {x, height(x, z), z};
      const float turn = random.range(0, 3.14159265F), lean = random.range(-0.05F, 0.05F);
      stand.rotation = {lean, std::sin(turn), lean / 2, std::cos(turn)};
      const float girth = random.range(0.6F, 1.2F);
      stand.scale = {at % 8 == 0 ? -girth : girth, random.range(0.5F, 1.5F), girth};
    }
    RAYMILL_RETURN_IF_ERROR(scene.end_patch("wood-" + std::to_string(mesh), stands));
  }
  return add_ground(ground, side + 20, height, scene);
}

}  // namespace

Result<SceneKind> parse_scene_kind(std::string_view name) {
  if (name == "terrain") return SceneKind::terrain;
  if (name == "city") return SceneKind::city;
  if (name == "forest") return SceneKind::forest;
  if (name == "mixed") return SceneKind::mixed;
  if (name == "woods") return SceneKind::woods;
  return Status(ErrorCode::invalid_argument,
                in_quotes(name) + " is not a kind of scene; terrain, city, forest, mixed and woods are");
}

Status generate(SceneKind kind, std::uint64_t triangles, std::uint64_t seed, unsigned meshes, SceneWriter& scene) {
  switch (kind) {
    case SceneKind::terrain:
      return terrain(triangles, seed, scene);
    case SceneKind::city:
      return city(triangles, seed, scene);
    case SceneKind::forest:
      return forest(triangles, seed, scene);
    case SceneKind::mixed:
      return mixed(triangles, seed, scene);
    case SceneKind::woods:
      return woods(triangles, seed, meshes, scene);
  }
  return {};
}

}  // namespace raymill::client
