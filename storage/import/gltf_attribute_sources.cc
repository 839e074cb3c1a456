#include "storage/import/gltf_attribute_sources.h"

#include <nlohmann/json.hpp>
#include <string>

#include "storage/import/json_members.h"

namespace raymill::storage {
namespace {

using nlohmann::json;

PrimitiveAttributes read_primitive(const json& primitive, AttributeSet asked, std::size_t accessors) {
  constexpr std::size_t kMostDracoIds = 1 << 16;
  PrimitiveAttributes sources;
  const json& attributes = member(primitive, "attributes");
  const json& draco = member(member(member(primitive, "extensions"), "KHR_draco_mesh_compression"), "attributes");
  for (const Attribute attribute : kAttributes) {
    const std::string name(kind_of(attribute).gltf_name);
    const json& value = member(attributes, name.c_str());
    if (!holds(asked, attribute) || value.is_null()) {
      continue;
    }
    AttributeSource& source = sources[static_cast<std::size_t>(attribute)];
    const int index = index_below(value, accessors);
    source.accessor = index >= 0 ? index : AttributeSource::kBroken;
    source.draco = index_below(member(draco, name.c_str()), kMostDracoIds);
  }
  return sources;
}

}  // namespace

const PrimitiveAttributes* GltfAttributeSources::find(int mesh, std::size_t primitive) const {
  const auto m = static_cast<std::size_t>(mesh);
  return m < primitives.size() && primitive < primitives[m].size() ? &primitives[m][primitive] : nullptr;
}

Result<GltfAttributeSources> read_attribute_sources(const json& root, AttributeSet asked, Ledger& ledger) {
  GltfAttributeSources sources;
  const json& meshes = member(root, "meshes");
  std::uint64_t bytes = 0;
  for (std::size_t i = 0; i < size_of(meshes); ++i) {
    bytes += sizeof(sources.primitives[0]) + size_of(member(meshes[i], "primitives")) * sizeof(PrimitiveAttributes);
  }
  RAYMILL_ASSIGN_OR_RETURN(sources.claim, ledger.claim(Tag::build, 2 * bytes));
  const std::size_t accessors = size_of(member(root, "accessors"));
  for (std::size_t i = 0; i < size_of(meshes); ++i) {
    auto& of_mesh = sources.primitives.emplace_back();
    const json& primitives = member(meshes[i], "primitives");
    for (std::size_t k = 0; k < size_of(primitives); ++k) {
      of_mesh.push_back(read_primitive(primitives[k], asked, accessors));
    }
  }
  return sources;
}

}  // namespace raymill::storage
