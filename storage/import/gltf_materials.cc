#include "storage/import/gltf_materials.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>

#include "storage/import/json_members.h"
#include "storage/import/message.h"

namespace raymill::storage {

namespace {

using nlohmann::json;

// A finite number; `otherwise` where there is none.
std::optional<double> finite_number(const json& value, double otherwise) {
  if (value.is_null()) {
    return otherwise;
  }
  return value.is_number() && std::isfinite(value.get<double>()) ? std::optional(value.get<double>()) : std::nullopt;
}

template <std::size_t N>
bool numbers(const json& value, std::array<double, N>& out) {
  if (value.is_null()) {
    return true;
  }
  bool good = value.is_array() && value.size() == N;
  for (std::size_t i = 0; good && i < N; ++i) {
    good = value[i].is_number() && std::isfinite(value[i].get<double>());
    out[i] = good ? value[i].get<double>() : 0;
  }
  return good;
}

constexpr const char* kMaterialRemedy =
    "; mend the material, or build with --ignore-alpha to take everything as opaque";

class MaterialReader {
 public:
  MaterialReader(const json& root, const MaskRule& rule) : root_(root), rule_(rule) {}

  Status read(std::size_t index, MaterialMask& out) {
    const json& material = member(root_, "materials")[index];
    out.name = message("materials[", index, "]");
    if (const json& name = member(material, "name"); name.is_string()) {
      out.name += " '" + name.get<std::string>().substr(0, kMostNameBytes) + "'";
    }
    const json& sides = member(material, "doubleSided");
    out.one_side = rule_.one_side && !(sides.is_boolean() && sides.get<bool>());
    const json& mode = member(material, "alphaMode");
    if (!mode.is_null() && mode != "OPAQUE" && mode != "MASK" && mode != "BLEND") {
      return fault(out, "alphaMode is none of OPAQUE, MASK and BLEND");
    }
    out.masked = (rule_.masks && mode == "MASK") || (rule_.blend_cutoff && mode == "BLEND");
    return out.masked ? read_mask(material, mode == "BLEND", out) : Status();
  }

 private:
  static constexpr std::size_t kMostNameBytes = 128;

  static Status fault(const MaterialMask& material, const std::string& what) {
    return bad_scene(material.name, ": ", what, kMaterialRemedy);
  }

  Status read_mask(const json& material, bool blends, MaterialMask& out) {
    const auto cutoff = blends ? rule_.blend_cutoff : finite_number(member(material, "alphaCutoff"), 0.5);
    if (!cutoff || *cutoff < 0) {
      return fault(out, "alphaCutoff is not a number of 0 or more");
    }
    out.cutoff = std::min(*cutoff, 2.0);  // above 1 nothing counts
    const json& shading = member(material, "pbrMetallicRoughness");
    std::array<double, 4> factor{1, 1, 1, 1};
    if (!numbers(member(shading, "baseColorFactor"), factor)) {
      return fault(out, "baseColorFactor is not four numbers");
    }
    out.factor = std::clamp(factor[3], 0.0, 1.0);
    const json& texture = member(shading, "baseColorTexture");
    return texture.is_null() ? Status() : read_texture(texture, out);
  }

  Status read_texture(const json& info, MaterialMask& out) {
    const json& textures = member(root_, "textures");
    const int texture = index_below(member(info, "index"), size_of(textures));
    if (texture < 0) {
      return fault(out, "baseColorTexture names a texture that is not there");
    }
    const json& transform = member(member(info, "extensions"), "KHR_texture_transform");
    const json& moved_set = member(transform, "texCoord");
    const json& set = moved_set.is_null() ? member(info, "texCoord") : moved_set;
    constexpr std::size_t kMostSets = 64;
    const int tex_coord = set.is_null() ? 0 : index_below(set, kMostSets);
    if (tex_coord < 0) {
      return fault(out, "baseColorTexture.texCoord is no number of a set");
    }
    out.tex_coord = static_cast<std::uint32_t>(tex_coord);
    RAYMILL_RETURN_IF_ERROR(read_transform(transform, out));
    const json& source = textures[static_cast<std::size_t>(texture)];
    RAYMILL_RETURN_IF_ERROR(read_sampler(member(source, "sampler"), out));
    out.image = index_below(image_of(source), size_of(member(root_, "images")));
    if (out.image < 0) {
      return fault(out, message("textures[", texture, "] names an image that is not there"));
    }
    out.image_name = message("images[", out.image, "]");
    return {};
  }

  // The core image, or that of an extension in whose format alone the texture comes.
  static const json& image_of(const json& texture) {
    const json* source = &member(texture, "source");
    for (const char* name : {"MSFT_texture_dds", "EXT_texture_webp", "EXT_texture_avif", "KHR_texture_basisu"}) {
      if (source->is_null()) {
        source = &member(member(member(texture, "extensions"), name), "source");
      }
    }
    return *source;
  }

  Status read_sampler(const json& index, MaterialMask& out) {
    if (index.is_null()) {
      return {};
    }
    const json& samplers = member(root_, "samplers");
    const int sampler = index_below(index, size_of(samplers));
    if (sampler < 0) {
      return fault(out, "its texture names a sampler that is not there");
    }
    for (const auto& [key, wrap] : {std::pair("wrapS", &out.wrap_s), std::pair("wrapT", &out.wrap_t)}) {
      constexpr int kRepeat = 10497, kMirror = 33648, kClamp = 33071;
      const json& value = member(samplers[static_cast<std::size_t>(sampler)], key);
      const int code = value.is_null() ? kRepeat : value.is_number_integer() ? value.get<int>() : 0;
      if (code != kRepeat && code != kMirror && code != kClamp) {
        return fault(out, message("samplers[", sampler, "].", key, " is none of 10497, 33648 and 33071"));
      }
      *wrap = code == kRepeat ? Wrap::repeat : code == kMirror ? Wrap::mirror : Wrap::clamp;
    }
    return {};
  }

  // KHR_texture_transform: scale, then rotation, then offset. Rotated are the coordinates, counterclockwise as one sees
  // them with v downwards.
  static Status read_transform(const json& transform, MaterialMask& out) {
    std::array<double, 2> offset{0, 0}, scale{1, 1};
    const std::optional<double> rotation = finite_number(member(transform, "rotation"), 0);
    if (!numbers(member(transform, "offset"), offset) || !numbers(member(transform, "scale"), scale) || !rotation) {
      return fault(out, "KHR_texture_transform holds what is not a number");
    }
    const double c = *rotation == 0 ? 1 : std::cos(*rotation), s = *rotation == 0 ? 0 : std::sin(*rotation);
    out.transform = {c * scale[0], s * scale[1], offset[0], -s * scale[0], c * scale[1], offset[1]};
    return {};
  }

  const json& root_;
  const MaskRule& rule_;
};

// Attribute ids of Draco are any numbers, accessors are checked against their section.
int attribute(const json& attributes, const std::string& name, std::size_t size) {
  return index_below(member(attributes, name.c_str()), size);
}

PrimitiveMaterial read_primitive(const json& root, const json& primitive, const std::vector<MaterialMask>& materials) {
  PrimitiveMaterial out;
  const int material = index_below(member(primitive, "material"), materials.size());
  if (material < 0 || !(materials[static_cast<std::size_t>(material)].masked ||
                        materials[static_cast<std::size_t>(material)].one_side)) {
    return out;
  }
  out.material = material;
  const std::string set = message("TEXCOORD_", materials[static_cast<std::size_t>(material)].tex_coord);
  const std::size_t accessors = size_of(member(root, "accessors"));
  const json& attributes = member(primitive, "attributes");
  out.tex_coords = attribute(attributes, set, accessors);
  out.colors = attribute(attributes, "COLOR_0", accessors);
  const json& draco = member(member(member(primitive, "extensions"), "KHR_draco_mesh_compression"), "attributes");
  constexpr std::size_t kMostIds = 1 << 16;
  out.draco_tex_coords = attribute(draco, set, kMostIds);
  out.draco_colors = attribute(draco, "COLOR_0", kMostIds);
  return out;
}

// A material of all primitives that have none has one side.
MaterialMask plain(const MaskRule& rule) {
  MaterialMask material;
  material.name = "the default material";
  material.one_side = rule.one_side;
  return material;
}

}  // namespace

const PrimitiveMaterial* GltfMaterials::find(int mesh, std::size_t primitive) const {
  const auto m = static_cast<std::size_t>(mesh);
  return m < primitives.size() && primitive < primitives[m].size() && primitives[m][primitive].material >= 0
             ? &primitives[m][primitive]
             : nullptr;
}

Result<GltfMaterials> read_materials(const json& root, const MaskRule& rule, Ledger& ledger) {
  GltfMaterials out;
  const std::size_t material_count = size_of(member(root, "materials"));
  const json& images = member(root, "images");
  const json& meshes = member(root, "meshes");
  std::uint64_t bytes = (material_count + 1) * sizeof(MaterialMask) + size_of(images) * sizeof(ImageSource);
  for (std::size_t i = 0; i < size_of(meshes); ++i) {
    bytes += sizeof(out.primitives[0]) + size_of(member(meshes[i], "primitives")) * sizeof(PrimitiveMaterial);
  }
  RAYMILL_ASSIGN_OR_RETURN(out.claim, ledger.claim(Tag::build, 2 * bytes));
  MaterialReader reader(root, rule);
  for (std::size_t i = 0; i < material_count; ++i) {
    RAYMILL_RETURN_IF_ERROR(reader.read(i, out.materials.emplace_back()));
  }
  out.images.resize(size_of(images));
  for (MaterialMask& material : out.materials) {
    if (material.image < 0) {
      continue;
    }
    const json& image = images[static_cast<std::size_t>(material.image)];
    ImageSource& source = out.images[static_cast<std::size_t>(material.image)];
    if (const json& uri = member(image, "uri"); uri.is_string() && source.uri.empty()) {
      bytes += uri.get_ref<const std::string&>().size();
      RAYMILL_RETURN_IF_ERROR(out.claim.resize(2 * bytes));
      source.uri = uri.get<std::string>();
    }
    source.buffer_view = index_below(member(image, "bufferView"), size_of(member(root, "bufferViews")));
    if (source.uri.empty() && source.buffer_view < 0) {
      return bad_scene(material.name, ": ", material.image_name, " has neither a uri nor a bufferView",
                       kMaterialRemedy);
    }
  }
  out.materials.push_back(plain(rule));
  for (std::size_t i = 0; i < size_of(meshes); ++i) {
    std::vector<PrimitiveMaterial>& of_mesh = out.primitives.emplace_back();
    const json& primitives = member(meshes[i], "primitives");
    for (std::size_t k = 0; k < size_of(primitives); ++k) {
      of_mesh.push_back(read_primitive(root, primitives[k], out.materials));
      if (member(primitives[k], "material").is_null() && rule.one_side) {
        of_mesh.back().material = static_cast<int>(material_count);
      }
    }
  }
  return out;
}

}  // namespace raymill::storage
