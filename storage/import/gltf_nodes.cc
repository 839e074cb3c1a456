#include "storage/import/gltf_nodes.h"

#include <limits>
#include <optional>
#include <string_view>
#include <vector>

#include "storage/import/gltf_attributes.h"
#include "storage/import/gltf_masks.h"
#include "storage/import/gltf_placements.h"
#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"

namespace raymill::storage {

namespace {

// What a triangle and an instance take in decoded pages, nodes included (storage/FORMAT.md, page measurements).
constexpr double kTriangleBytes = 24, kInstanceBytes = 170;

std::string name_or_number(const std::string& name, std::string_view kind, int index) {
  return name.empty() ? message(kind, index) : name;
}

class NodeImport {
 public:
  NodeImport(const PrimitiveContext& context, const GltfScene& scene, const std::string& file,
             const ImportOptions& options)
      : context_(context),
        model_(context.document.model()),
        scene_(scene),
        file_(file),
        options_(options),
        meshes_(model_.meshes.size()) {}

  Status run() {
    if (options_.instances != nullptr && options_.rule != InstanceRule::never) {
      RAYMILL_RETURN_IF_ERROR(choose_objects());
    }
    for (const PlacedNode& placed : scene_.nodes) {
      if (node_of(placed).mesh >= 0) {
        RAYMILL_RETURN_IF_ERROR(import_node(placed));
      }
    }
    return context_.out.flush();
  }

 private:
  struct Counts {
    std::uint64_t triangles = 0, kept = 0;
  };
  struct Mesh {
    std::uint64_t placements = 0;
    bool is_object = false;
    std::optional<InstanceSink::Object> object;
    std::vector<Counts> counts;  // [primitive] of the object
  };
  // A node's mesh on its way.
  struct Visit {
    const PlacedNode& placed;
    const tinygltf::Mesh& source;
    Mesh& mesh;
    std::size_t first_entry;
    std::uint64_t first_id;
  };

  [[nodiscard]] const tinygltf::Node& node_of(const PlacedNode& placed) const {
    return model_.nodes[static_cast<std::size_t>(placed.node)];
  }

  [[nodiscard]] Result<GltfPlacements> open_placements(const PlacedNode& placed) const {
    Result<GltfPlacements> placements = GltfPlacements::open(node_of(placed), placed.world_from_node, context_);
    return placements ? std::move(placements)
                      : Result<GltfPlacements>(in_context(message("nodes[", placed.node, "]"), placements.status()));
  }

  // Triangles that the accessors promise.
  [[nodiscard]] double promised(const tinygltf::Mesh& mesh) const {
    double triangles = 0;
    for (const tinygltf::Primitive& primitive : mesh.primitives) {
      const auto position = primitive.attributes.find("POSITION");
      if (primitive.mode < TINYGLTF_MODE_TRIANGLES || position == primitive.attributes.end()) {
        continue;
      }
      const int indices = GltfDocument::indices_of(primitive);
      const auto corners =
          double(model_.accessors[static_cast<std::size_t>(indices >= 0 ? indices : position->second)].count);
      triangles += primitive.mode == TINYGLTF_MODE_TRIANGLES ? corners / 3 : corners;
    }
    return triangles;
  }

  Status choose_objects() {
    for (const PlacedNode& placed : scene_.nodes) {
      if (node_of(placed).mesh >= 0) {
        RAYMILL_ASSIGN_OR_RETURN(const GltfPlacements placements, open_placements(placed));
        meshes_[static_cast<std::size_t>(node_of(placed).mesh)].placements += placements.count();
      }
    }
    for (std::size_t i = 0; i < meshes_.size(); ++i) {
      const double triangles = promised(model_.meshes[i]), placements = double(meshes_[i].placements);
      meshes_[i].is_object =
          options_.rule == InstanceRule::always ||
          2 * (triangles * kTriangleBytes + placements * kInstanceBytes) <= placements * triangles * kTriangleBytes;
    }
    return {};
  }

  Status import_node(const PlacedNode& placed) {
    const tinygltf::Node& node = node_of(placed);
    ImportReport& report = context_.report;
    if (node.skin >= 0) {
      ++report.counts[ImportCode::skin_at_rest];
    }
    RAYMILL_ASSIGN_OR_RETURN(GltfPlacements placements, open_placements(placed));
    if (placements.by_extension()) {
      report.counts[ImportCode::gpu_instances] += placements.count();
    }
    const auto mesh = static_cast<std::size_t>(node.mesh);
    const Visit visit{placed, model_.meshes[mesh], meshes_[mesh], report.geometries.size(), report.geometry_count};
    RAYMILL_RETURN_IF_ERROR(add_geometries(visit, placements.count()));
    if (visit.mesh.is_object && !visit.mesh.object && placements.count() > 0) {
      RAYMILL_RETURN_IF_ERROR(import_object(visit));
    }
    for (std::uint64_t copy = 0; copy < placements.count(); ++copy) {
      RAYMILL_ASSIGN_OR_RETURN(const Transform world_from_mesh, placements.world_from_mesh(copy));
      RAYMILL_RETURN_IF_ERROR(place(visit, copy, world_from_mesh));
    }
    return {};
  }

  Status add_geometries(const Visit& visit, std::uint64_t copies) {
    ImportReport& report = context_.report;
    const std::size_t primitives = visit.source.primitives.size();
    if (visit.first_id + copies * primitives >= std::numeric_limits<std::uint32_t>::max()) {
      return {ErrorCode::unsupported, message("nodes[", visit.placed.node,
                                              "] makes more than 2^32 geometries of the scene, more than ids reach")};
    }
    for (std::size_t i = 0; i < primitives; ++i) {
      GeometryInfo& geometry = report.add_geometry();
      geometry.file = file_;
      geometry.node = name_or_number(node_of(visit.placed).name, "node", visit.placed.node);
      geometry.mesh = name_or_number(visit.source.name, "mesh", node_of(visit.placed).mesh);
      geometry.primitive = static_cast<std::uint32_t>(i);
      geometry.copies = static_cast<std::uint32_t>(copies);
      geometry.stride = copies == 1 ? 1 : static_cast<std::uint32_t>(primitives);
    }
    report.geometry_count = visit.first_id + copies * primitives;
    return {};
  }

  // The mesh in its own space, under geometry ids that begin with 0. Its triangles count when it is placed.
  Status import_object(const Visit& visit) {
    ImportReport& report = context_.report;
    RAYMILL_RETURN_IF_ERROR(context_.out.flush());
    RAYMILL_RETURN_IF_ERROR(options_.instances->begin_object());
    const Counts before{report.triangles, report.kept};
    for (std::size_t i = 0; i < visit.source.primitives.size(); ++i) {
      RAYMILL_RETURN_IF_ERROR(import_one(visit, i, static_cast<std::uint32_t>(i), Transform()));
      GeometryInfo& geometry = report.geometries[visit.first_entry + i];
      visit.mesh.counts.push_back({geometry.triangles, geometry.kept});
      geometry.triangles = geometry.kept = 0;
    }
    report.triangles = before.triangles;
    report.kept = before.kept;
    RAYMILL_RETURN_IF_ERROR(context_.out.flush());
    RAYMILL_ASSIGN_OR_RETURN(visit.mesh.object, options_.instances->end_object());
    return {};
  }

  Status place(const Visit& visit, std::uint64_t copy, const Transform& world_from_mesh) {
    const std::size_t primitives = visit.source.primitives.size();
    const auto base = static_cast<std::uint32_t>(visit.first_id + copy * primitives);
    RAYMILL_RETURN_IF_ERROR(place_attributes(visit, base, world_from_mesh));
    if (visit.mesh.object && can_place(*visit.mesh.object, world_from_mesh)) {
      ImportReport& report = context_.report;
      for (std::size_t i = 0; i < primitives; ++i) {
        report.geometries[visit.first_entry + i].triangles += visit.mesh.counts[i].triangles;
        report.geometries[visit.first_entry + i].kept += visit.mesh.counts[i].kept;
        report.triangles += visit.mesh.counts[i].triangles;
        report.kept += visit.mesh.counts[i].kept;
      }
      if (visit.mesh.object->box.empty()) {
        return {};
      }
      if (report.instances == std::numeric_limits<std::uint32_t>::max()) {
        return {ErrorCode::unsupported, "the scene has 2^32 instances or more, more than ids reach"};
      }
      return options_.instances->place({placement_of(world_from_mesh), visit.mesh.object->number, base,
                                        static_cast<std::uint32_t>(report.instances++)});
    }
    RAYMILL_ASSIGN_OR_RETURN(const Transform transform, enter_part(visit, world_from_mesh));
    for (std::size_t i = 0; i < primitives; ++i) {
      RAYMILL_RETURN_IF_ERROR(import_one(visit, i, base + static_cast<std::uint32_t>(i), transform));
    }
    return {};
  }

  // Into the space of the part that the mesh is in, if it is in one.
  Result<Transform> enter_part(const Visit& visit, const Transform& world_from_mesh) {
    if (options_.parts.empty()) {
      return world_from_mesh;
    }
    const std::uint32_t part = part_of(options_.parts, piece_of(model_, {visit.placed.node, world_from_mesh}).box);
    RAYMILL_RETURN_IF_ERROR(context_.out.flush());
    options_.part_sink->enter_part(part);
    Transform transform = world_from_mesh;
    if (part != kNoPart) {
      transform.move_back(options_.parts[part].origin.position());
    }
    return transform;
  }

  Status place_attributes(const Visit& visit, std::uint32_t base, const Transform& world_from_mesh) {
    for (std::size_t i = 0; context_.attributes != nullptr && i < visit.source.primitives.size(); ++i) {
      const int mesh = node_of(visit.placed).mesh;
      const Status status = context_.attributes->place(mesh, i, base + static_cast<std::uint32_t>(i), world_from_mesh);
      if (!status.ok()) {
        return in_context(message("meshes[", mesh, "].primitives[", i, "]"), status);
      }
    }
    return {};
  }

  static bool can_place(const InstanceSink::Object& object, const Transform& world_from_mesh) {
    const Placement placement = placement_of(world_from_mesh);
    return object.box.empty() || (invertible(placement) && in_range(placed_box(placement, object.box)));
  }

  Status import_one(const Visit& visit, std::size_t primitive, std::uint32_t geometry_id, const Transform& transform) {
    context_.out.begin_copy(visit.first_entry + primitive, geometry_id);
    Status status = begin_masks(visit, primitive, geometry_id, transform);
    if (status.ok()) {
      status = import_primitive(visit.source.primitives[primitive], transform, context_);
    }
    return status.ok() || context_.out.sink_failed()
               ? status
               : in_context(message("meshes[", node_of(visit.placed).mesh, "].primitives[", primitive, "]"), status);
  }

  Status begin_masks(const Visit& visit, std::size_t primitive, std::uint32_t geometry_id, const Transform& transform) {
    if (context_.masks != nullptr) {
      RAYMILL_ASSIGN_OR_RETURN(const TriangleWriter::Faces faces,
                               context_.masks->begin(node_of(visit.placed).mesh, primitive, geometry_id, transform));
      context_.out.set_faces(faces);
    }
    return {};
  }

  const PrimitiveContext& context_;
  const tinygltf::Model& model_;
  const GltfScene& scene_;
  const std::string& file_;
  const ImportOptions& options_;
  std::vector<Mesh> meshes_;
};

}  // namespace

Status import_nodes(const PrimitiveContext& context, const GltfScene& scene, const std::string& file,
                    const ImportOptions& options) {
  return NodeImport(context, scene, file, options).run();
}

}  // namespace raymill::storage
