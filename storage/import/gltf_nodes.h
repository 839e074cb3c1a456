// The nodes of a scene: each mesh becomes triangles in world space, or an object and where it is placed.
#pragma once

#include <string>

#include "storage/import/gltf_primitives.h"
#include "storage/import/gltf_scene.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

/// Hands on all nodes' meshes in their order. Geometry ids do not depend on what becomes of a mesh. A placement that
/// cannot be inverted well (invertible()) is made triangles whatever the rule. Errors: those of import_primitive() and
/// of the sinks.
Status import_nodes(const PrimitiveContext& context, const GltfScene& scene, const std::string& file,
                    const ImportOptions& options);

}  // namespace raymill::storage
