#include "storage/import/gltf_extensions.h"

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>

#include "storage/import/message.h"

namespace raymill::storage {

namespace {

constexpr std::string_view kModelled[] = {"EXT_mesh_gpu_instancing", "EXT_meshopt_compression",
                                          "KHR_draco_mesh_compression", "KHR_mesh_quantization"};

// Materials, textures, lights, metadata and animation: the triangles at rest are the same without them.
constexpr std::string_view kShadingOnly[] = {
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
    "KHR_techniques_webgl",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_texture_dds",
};

bool contains(std::span<const std::string_view> names, std::string_view name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

}  // namespace

Result<ExtensionUse> check_extensions(const nlohmann::json& root) {
  ExtensionUse use;
  std::set<std::string> names;
  for (const char* key : {"extensionsRequired", "extensionsUsed"}) {
    if (!root.contains(key)) {
      continue;
    }
    for (const auto& element : root[key]) {
      const auto name = element.get<std::string>();
      if (key == std::string_view("extensionsRequired") && !contains(kModelled, name) &&
          !contains(kShadingOnly, name)) {
        return Status(ErrorCode::unsupported,
                      message("requires the extension ", name, ", which Raymill does not read; export without it"));
      }
      use.quantization = use.quantization || name == "KHR_mesh_quantization";
      if (!contains(kModelled, name)) {
        names.insert(name);
      }
    }
  }
  use.ignored.assign(std::make_move_iterator(names.begin()), std::make_move_iterator(names.end()));
  return use;
}

}  // namespace raymill::storage
