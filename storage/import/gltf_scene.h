// GltfScene: which nodes a scene shows and where they stand.
//
// Order is the order of the file's `nodes` array, not of the hierarchy: it is what geometry ids follow. Hierarchies are
// walked with a stack of our own, so their depth costs heap and not the thread's stack. Immutable.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"
#include "storage/import/scene_parts.h"
#include "storage/import/transform.h"

namespace tinygltf {
class Model;
}  // namespace tinygltf

namespace raymill::storage {

struct PlacedNode {
  int node = 0;
  Transform world_from_node;
};

struct GltfScene {
  BudgetReservation claim;
  std::vector<PlacedNode> nodes;  ///< rising by node
};

/// The nodes reachable from `scene`; from the file's default scene, or else its first, where not given; from every node
/// that is no child where the file has no scenes.
/// Errors: invalid_argument (no such scene), bad_scene (a cycle anywhere, a node reached twice, a matrix that is not
/// affine), budget_exceeded.
Result<GltfScene> place_nodes(const tinygltf::Model& model, std::optional<std::uint32_t> scene, Ledger& ledger);

/// A node's mesh as the node places it, by what its accessors say of their least and most positions. The box is empty
/// where they do not say it, and where EXT_mesh_gpu_instancing places the mesh.
ScenePiece piece_of(const tinygltf::Model& model, const PlacedNode& placed);

/// The cameras of the placed nodes, in their order.
std::vector<CameraInfo> placed_cameras(const tinygltf::Model& model, const GltfScene& scene);

}  // namespace raymill::storage
