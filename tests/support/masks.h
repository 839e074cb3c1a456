// Scenes of triangles that masks cut out: as a store, and as what a ray should find in it.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "storage/import/mask_sink.h"
#include "tests/support/stores.h"
#include "traversal/query.h"

namespace raymill::tests {

struct MaskedScene {
  std::vector<storage::AlphaMap> maps;
  struct Geometry {
    Mesh mesh;
    std::vector<storage::FaceMask> faces;  ///< [triangle]; mask: of maps; none: all are opaque
    storage::Sides sides = storage::Sides::both;
  };
  std::vector<Geometry> geometries;
};

/// Blobs of so many bits a texel.
storage::AlphaMap random_map(Random& random, std::uint32_t width, std::uint32_t height, std::uint32_t bits);
/// Triangles of [-1, 1]^3 with masks of each sort, some of them opaque, some of them with one side.
MaskedScene random_masked_scene(Random& random, std::size_t triangles);
/// Faces are judged as an import does it; what nothing is left of is left out.
std::string build_masked(const TempFolder& folder, const std::string& name, const MaskedScene& scene,
                         BuildConfig config = small_pages());

/// Whether the point counts, by the map itself.
bool counts_at(const MaskedScene& scene, const storage::FaceMask& face, double u, double v);
/// The nearest hit that counts, each triangle tested in float64; t is not rounded as the kernels do it.
Hit nearest(const MaskedScene& scene, const Ray& ray);

}  // namespace raymill::tests
