#include "storage/import/gltf_placements.h"

#include <algorithm>
#include <string>

#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"

namespace raymill::storage {

namespace {

constexpr const char* kInstancing = "EXT_mesh_gpu_instancing";
constexpr std::size_t kTranslation = 0, kRotation = 1, kScale = 2;
constexpr const char* kNames[] = {"TRANSLATION", "ROTATION", "SCALE"};

}  // namespace

Result<GltfPlacements> GltfPlacements::open(const tinygltf::Node& node, const Transform& world_from_node,
                                            const PrimitiveContext& context) {
  GltfPlacements placements(world_from_node);
  const auto extension = node.extensions.find(kInstancing);
  if (extension == node.extensions.end()) {
    return placements;
  }
  placements.by_extension_ = true;
  const tinygltf::Value& attributes = extension->second.Get("attributes");
  bool any = false;
  for (std::size_t i = 0; i < placements.attributes_.size(); ++i) {
    if (!attributes.Has(kNames[i])) {
      continue;
    }
    const int index = attributes.Get(kNames[i]).GetNumberAsInt();
    RAYMILL_ASSIGN_OR_RETURN(
        GltfAccessor accessor,
        GltfAccessor::open(context.document.model(), index, i == kRotation ? 4 : 3, context.buffers, context.ledger));
    const bool small =
        accessor.normalized() && (accessor.type() == ComponentType::int8 || accessor.type() == ComponentType::int16);
    if (accessor.type() != ComponentType::float32 && !(i == kRotation && small)) {
      return bad_scene(kInstancing, ".attributes.", kNames[i], " is of a component type that the extension forbids");
    }
    if (any && accessor.count() != placements.count_) {
      return bad_scene(kInstancing, ".attributes.", kNames[i], " has ", accessor.count(), " elements, another one ",
                       placements.count_);
    }
    any = true;
    placements.count_ = accessor.count();
    placements.attributes_[i].accessor = std::move(accessor);
  }
  if (!any) {
    return bad_scene(kInstancing,
                     ".attributes has none of TRANSLATION, ROTATION and SCALE, one of which must say how often "
                     "and where the mesh is placed");
  }
  return placements;
}

Status GltfPlacements::read_piece(std::uint64_t first) {
  first_ = first;
  end_ = std::min(count_, first + kPieceElements);
  for (Attribute& attribute : attributes_) {
    if (attribute.accessor) {
      attribute.piece.resize((end_ - first_) * attribute.accessor->element_bytes());
      RAYMILL_RETURN_IF_ERROR(attribute.accessor->read(first_, attribute.piece));
    }
  }
  return {};
}

double GltfPlacements::value(std::size_t attribute, std::uint64_t index, std::uint32_t component) const {
  const GltfAccessor& accessor = *attributes_[attribute].accessor;
  const std::byte* element = attributes_[attribute].piece.data() + (index - first_) * accessor.element_bytes();
  return component_value(element + component * size_bytes(accessor.type()), accessor.type(), accessor.normalized());
}

Result<Transform> GltfPlacements::world_from_mesh(std::uint64_t index) {
  if (!by_extension_) {
    return world_from_node_;
  }
  if (index < first_ || index >= end_) {
    RAYMILL_RETURN_IF_ERROR(read_piece(index));
  }
  const auto vector = [&](std::size_t attribute, double otherwise) {
    return attributes_[attribute].accessor
               ? Vec3d{value(attribute, index, 0), value(attribute, index, 1), value(attribute, index, 2)}
               : Vec3d{otherwise, otherwise, otherwise};
  };
  std::array<double, 4> rotation{0, 0, 0, 1};
  for (std::uint32_t i = 0; attributes_[kRotation].accessor && i < rotation.size(); ++i) {
    rotation[i] = value(kRotation, index, i);
  }
  return world_from_node_ * from_trs(vector(kTranslation, 0), rotation, vector(kScale, 1));
}

}  // namespace raymill::storage
