// The triangles of a store, for a peer that is to see the same ones.
#pragma once

#include <string>
#include <vector>

#include "storage/base/placement.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"

namespace raymill::client {

/// Hands every triangle of the store at `path` to `sink`, page by page, as the kernels see it: after codec and lattice.
/// Errors: those of opening and reading a store, unsupported (it has instances), and the sink's.
Status read_store_triangles(const std::string& path, storage::TriangleSink& sink);

/// A store with instances, in memory.
struct PlacedTriangles {
  struct Place {
    std::size_t object = 0;
    storage::Placement world_from_object{};
  };
  std::vector<storage::Triangle> world;
  std::vector<std::vector<storage::Triangle>> objects;
  std::vector<Place> places;
};
/// Empty where the store has no instances. Errors: as above.
Result<PlacedTriangles> read_placed_triangles(const std::string& path);

}  // namespace raymill::client
