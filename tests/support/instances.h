// Scenes of placed objects: as a store, and as what a ray should find in it.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "storage/base/placement.h"
#include "tests/support/stores.h"

namespace raymill::tests {

struct PlacedScene {
  using Matrix = std::array<double, 16>;  ///< column-major, affine
  struct Place {
    std::uint32_t object = 0;
    Matrix world_from_object{};
  };
  Scene world;                 ///< geometries 0, 1, ... of the world
  std::vector<Scene> objects;  ///< each with its meshes
  std::vector<Place> places;   ///< in the order of instance ids; geometry ids number on
};

/// Turned, mirrored, sheared or stretched; moved by up to `reach`.
PlacedScene::Matrix random_matrix(Random& random, float reach);
/// A few objects, each placed often, and something in the world.
PlacedScene random_placed_scene(Random& random, std::size_t places);
/// All of it in world space, corners rounded once.
Scene flattened(const PlacedScene& scene);

std::string build_placed(const TempFolder& folder, const std::string& name, const PlacedScene& scene,
                         BuildConfig config = small_pages());

/// The closest hits as storage/FORMAT.md and traversal/kernels/instance-inl.h promise them, found without an instanced
/// store: each object's own store is traced with the rays that each place takes into its space.
std::vector<Hit> expected_hits(const TempFolder& folder, const PlacedScene& scene, std::span<const Ray> rays,
                               Mode mode);

}  // namespace raymill::tests
