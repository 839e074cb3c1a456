#include "storage/import/gltf_scene.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"

namespace raymill::storage {

namespace {

std::size_t at(int index) { return static_cast<std::size_t>(index); }

// What a normalised integer's bounds count in.
double unit_of(const tinygltf::Accessor& accessor) {
  switch (accessor.normalized ? accessor.componentType : 0) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
      return 127;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return 255;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
      return 32767;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return 65535;
    default:
      return 1;
  }
}

// By the accessors of its primitives of triangles; none where one of them does not say.
std::optional<Extent> extent_of(const tinygltf::Model& model, const tinygltf::Mesh& mesh) {
  Extent extent;
  for (const tinygltf::Primitive& primitive : mesh.primitives) {
    const auto position = primitive.attributes.find("POSITION");
    if (primitive.mode < TINYGLTF_MODE_TRIANGLES || position == primitive.attributes.end()) {
      continue;
    }
    const tinygltf::Accessor& accessor = model.accessors[at(position->second)];
    if (accessor.minValues.size() != 3 || accessor.maxValues.size() != 3) {
      return std::nullopt;
    }
    const double unit = unit_of(accessor);
    for (const std::vector<double>& p : {accessor.minValues, accessor.maxValues}) {
      extent.grow({p[0] / unit, p[1] / unit, p[2] / unit});
    }
  }
  return extent.empty() ? std::nullopt : std::optional<Extent>(extent);
}

Transform trs_of(const tinygltf::Node& node) {
  const auto value = [](const std::vector<double>& values, std::size_t i, double otherwise) {
    return values.empty() ? otherwise : values[i];
  };
  const auto vector = [&](const std::vector<double>& values, double otherwise) {
    return Vec3d{value(values, 0, otherwise), value(values, 1, otherwise), value(values, 2, otherwise)};
  };
  return from_trs(
      vector(node.translation, 0),
      {value(node.rotation, 0, 0), value(node.rotation, 1, 0), value(node.rotation, 2, 0), value(node.rotation, 3, 1)},
      vector(node.scale, 1));
}

Result<Transform> local_transform(const tinygltf::Model& model, int node) {
  const tinygltf::Node& declared = model.nodes[at(node)];
  if (declared.matrix.empty()) {
    return trs_of(declared);
  }
  Transform transform;
  std::copy(declared.matrix.begin(), declared.matrix.end(), transform.m.begin());
  constexpr double kLastRowSlack = 1e-6;  // exporters write matrices in float32
  for (const int i : {3, 7, 11, 15}) {
    const double expected = i == 15 ? 1 : 0;
    if (!(std::abs(transform.m[at(i)] - expected) <= kLastRowSlack)) {
      return bad_scene("nodes[", node, "].matrix is not affine: its last row must be 0 0 0 1");
    }
    transform.m[at(i)] = expected;
  }
  return transform;
}

// Kahn 1962: takes nodes away whose parents are all gone; what cannot be taken away lies on or below a cycle.
Status check_no_cycle(const tinygltf::Model& model, std::vector<std::uint32_t> parents, std::vector<int> ready) {
  std::size_t taken = ready.size();
  while (!ready.empty()) {
    const int node = ready.back();
    ready.pop_back();
    for (const int child : model.nodes[at(node)].children) {
      if (--parents[at(child)] == 0) {
        ready.push_back(child);
        ++taken;
      }
    }
  }
  if (taken == model.nodes.size()) {
    return {};
  }
  // Up the parents from any node that is left: after as many steps as there are nodes, one stands on the cycle.
  int node = 0;
  while (parents[at(node)] == 0) {
    ++node;
  }
  std::vector<int> parent_of(model.nodes.size(), -1);
  for (std::size_t i = 0; i < model.nodes.size(); ++i) {
    for (const int child : model.nodes[i].children) {
      if (parents[i] != 0) {
        parent_of[at(child)] = static_cast<int>(i);
      }
    }
  }
  for (std::size_t step = 0; step < model.nodes.size(); ++step) {
    node = parent_of[at(node)];
  }
  return bad_scene("nodes[", node, "] is its own ancestor; a hierarchy must not run in a circle");
}

Result<std::vector<int>> root_nodes(const tinygltf::Model& model, std::optional<std::uint32_t> scene,
                                    const std::vector<int>& orphans) {
  if (scene && *scene >= model.scenes.size()) {
    return Status(ErrorCode::invalid_argument,
                  message("has no scene ", *scene, "; it has ", model.scenes.size(), ", counted from 0"));
  }
  if (model.scenes.empty()) {
    return orphans;
  }
  const std::size_t chosen = scene ? *scene : model.defaultScene >= 0 ? at(model.defaultScene) : 0;
  return model.scenes[chosen].nodes;
}

}  // namespace

Result<GltfScene> place_nodes(const tinygltf::Model& model, std::optional<std::uint32_t> scene, Ledger& ledger) {
  GltfScene placed;
  const std::uint64_t node_count = model.nodes.size();
  constexpr std::uint64_t kScratchBytes = 64;  // per node: parents, two stacks that double, marks
  RAYMILL_ASSIGN_OR_RETURN(placed.claim,
                           ledger.claim(Tag::build, node_count * (2 * sizeof(PlacedNode) + kScratchBytes)));
  std::vector<std::uint32_t> parents(node_count, 0);
  for (const tinygltf::Node& node : model.nodes) {
    for (const int child : node.children) {
      ++parents[at(child)];
    }
  }
  std::vector<int> orphans;
  for (std::size_t node = 0; node < node_count; ++node) {
    if (parents[node] == 0) {
      orphans.push_back(static_cast<int>(node));
    }
  }
  RAYMILL_RETURN_IF_ERROR(check_no_cycle(model, parents, orphans));
  RAYMILL_ASSIGN_OR_RETURN(std::vector<int> roots, root_nodes(model, scene, orphans));

  std::vector<bool> reached(node_count, false);
  std::vector<PlacedNode> stack;
  const auto reach = [&](int node, const Transform& world_from_parent) -> Status {
    if (reached[at(node)]) {
      return bad_scene("nodes[", node, "] is reached twice; a node has one parent and one place in a scene");
    }
    reached[at(node)] = true;
    RAYMILL_ASSIGN_OR_RETURN(const Transform local, local_transform(model, node));
    stack.push_back({node, world_from_parent * local});
    return {};
  };
  for (const int root : roots) {
    RAYMILL_RETURN_IF_ERROR(reach(root, Transform{}));
    while (!stack.empty()) {
      placed.nodes.push_back(stack.back());
      stack.pop_back();
      const PlacedNode parent = placed.nodes.back();
      for (const int child : model.nodes[at(parent.node)].children) {
        RAYMILL_RETURN_IF_ERROR(reach(child, parent.world_from_node));
      }
    }
  }
  std::sort(placed.nodes.begin(), placed.nodes.end(),
            [](const PlacedNode& a, const PlacedNode& b) { return a.node < b.node; });
  return placed;
}

ScenePiece piece_of(const tinygltf::Model& model, const PlacedNode& placed) {
  const tinygltf::Node& node = model.nodes[at(placed.node)];
  ScenePiece piece;
  if (node.mesh < 0 || node.extensions.contains("EXT_mesh_gpu_instancing")) {
    return piece;
  }
  const std::optional<Extent> own = extent_of(model, model.meshes[at(node.mesh)]);
  if (!own) {
    return piece;
  }
  const auto& m = placed.world_from_node.m;
  double moved = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double lower = m[12 + axis], upper = m[12 + axis];
    for (std::size_t column = 0; column < 3; ++column) {
      const double a = m[column * 4 + axis] * own->lower[column], b = m[column * 4 + axis] * own->upper[column];
      lower += std::min(a, b);
      upper += std::max(a, b);
    }
    piece.box.lower[axis] = lower;
    piece.box.upper[axis] = upper;
    moved = std::max(moved, std::fabs(m[12 + axis]));
  }
  // Where the mesh's own float32 reaches as far, it has lost what there was to lose.
  piece.gains = moved >= piece.box.reach() / 2;
  return piece;
}

std::vector<CameraInfo> placed_cameras(const tinygltf::Model& model, const GltfScene& scene) {
  std::vector<CameraInfo> cameras;
  for (const PlacedNode& placed : scene.nodes) {
    const tinygltf::Node& node = model.nodes[at(placed.node)];
    if (node.camera < 0) {
      continue;
    }
    const tinygltf::Camera& declared = model.cameras[at(node.camera)];
    CameraInfo& camera = cameras.emplace_back();
    camera.name = !declared.name.empty() ? declared.name
                  : !node.name.empty()   ? node.name
                                         : message("node", placed.node);
    camera.perspective = declared.type != "orthographic";
    camera.yfov_radians = declared.perspective.yfov;
    camera.aspect_ratio = declared.perspective.aspectRatio;
    camera.ymag = declared.orthographic.ymag;
    std::copy(placed.world_from_node.m.begin(), placed.world_from_node.m.end(), camera.world_from_camera);
  }
  return cameras;
}

}  // namespace raymill::storage
