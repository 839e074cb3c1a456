// Scenes made up for tests and benchmarks: any size, the same bytes for the same seed, never held in memory.
#pragma once

#include <cstdint>
#include <functional>
#include <string_view>

#include "client/cli/generate/scene_writer.h"

namespace raymill::client {

enum class SceneKind : std::uint8_t {
  terrain,  ///< a fractal heightfield: even triangles, one surface
  city,     ///< blocks of buildings with window frames: long and short triangles, axis-aligned
  forest,   ///< trees and grass of thin triangles over ground: the hard case for boxes
  mixed,    ///< a city in a valley, forest beside it, mountains around
  woods     ///< kinds of tree, each stored once and placed often (EXT_mesh_gpu_instancing), over ground
};
Result<SceneKind> parse_scene_kind(std::string_view name);

/// Writes exactly `triangles` triangles and the scene's cameras to `scene`. woods: of so many kinds of tree, and as
/// near as whole trees come. Errors: the writer's, invalid_argument (fewer triangles than the trees need once).
Status generate(SceneKind kind, std::uint64_t triangles, std::uint64_t seed, unsigned meshes, SceneWriter& scene);

// The parts that scenes are put together from. Lengths are metres, y is up.

using HeightField = std::function<float(float x, float z)>;

/// A square of side `side` in the middle of the plane with exactly `triangles` triangles over `height`, in tiles that
/// share their border vertices.
Status add_ground(std::uint64_t triangles, float side, const HeightField& height, SceneWriter& scene);

/// Streets and blocks around (x, z) with at most `triangles` triangles; `side` gets the square's length. Stands on y =
/// 0.
Status add_city(std::uint64_t triangles, std::uint64_t seed, float x, float z, SceneWriter& scene, float& side);

/// Trees and grass around (x, z), standing on `height`, with at most `triangles` triangles.
Status add_forest(std::uint64_t triangles, std::uint64_t seed, float x, float z, const HeightField& height,
                  SceneWriter& scene, float& side);
/// A clump of trees of kWoodTriangles triangles around the origin, standing on y = 0.
constexpr std::uint64_t kWoodTriangles = 4890;
void add_wood(std::uint64_t seed, SceneWriter& scene);
/// The side that add_city() and add_forest() will report.
float city_side(std::uint64_t triangles, std::uint64_t seed);
float forest_side(std::uint64_t triangles, std::uint64_t seed);

}  // namespace raymill::client
