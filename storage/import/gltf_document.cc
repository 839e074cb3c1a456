#include "storage/import/gltf_document.h"

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "storage/import/gltf_extensions.h"
#include "storage/import/gltf_json.h"
#include "storage/import/gltf_schema.h"
#include "storage/import/message.h"
#include "storage/import/tinygltf_config.h"

namespace raymill::storage {

namespace {

using nlohmann::json;

// Index accessors travel through tinygltf under this attribute's name: it refuses those without a bufferView, which
// is what a Draco primitive has. No attribute of the file can collide: only POSITION is kept of them.
constexpr const char* kIndicesAttribute = "RAYMILL_INDICES";

Status check_version(const json& asset) {
  const auto version = asset["version"].get<std::string>();
  const auto needed = asset.value("minVersion", version);
  for (const std::string& text : {version, needed}) {
    if (text.empty() || text.find_first_not_of("0123456789.") != std::string::npos) {
      return bad_scene("asset.version is not a version number");
    }
  }
  if (!version.starts_with("2.") || (asset.contains("minVersion") && needed != "2.0")) {
    return {ErrorCode::unsupported, message("asset.version asks for glTF ", needed, " and Raymill reads glTF 2.0")};
  }
  return {};
}

std::vector<BufferDeclaration> take_buffer_declarations(json& root) {
  std::vector<BufferDeclaration> buffers;
  const auto section = root.find("buffers");
  if (section == root.end()) {
    return buffers;
  }
  for (json& buffer : *section) {
    BufferDeclaration& declaration = buffers.emplace_back();
    declaration.size_bytes = buffer["byteLength"].get<std::uint64_t>();
    declaration.meshopt_fallback = buffer.contains("extensions") && !buffer["extensions"].empty();
    if (buffer.contains("uri")) {
      declaration.uri = std::move(buffer["uri"].get_ref<std::string&>());
    }
  }
  root.erase(section);
  return buffers;
}

// A compressed view becomes a view of all of a buffer of its own, which stands for what it decodes to; a fallback that
// it points to is not looked at.
Status take_meshopt_views(json& root, std::vector<BufferDeclaration>& buffers) {
  const auto section = root.find("bufferViews");
  for (std::size_t i = 0; section != root.end() && i < section->size(); ++i) {
    json& view = (*section)[i];
    const auto extensions = view.find("extensions");
    if (extensions == view.end() || !extensions->contains("EXT_meshopt_compression")) {
      continue;
    }
    const Result<MeshoptView> parsed = parse_meshopt((*extensions)["EXT_meshopt_compression"]);
    if (!parsed.ok()) {
      return in_context(message("bufferViews[", i, "].extensions.EXT_meshopt_compression"), parsed.status());
    }
    if (view["byteLength"].get<std::uint64_t>() != parsed->decoded_bytes()) {
      return bad_scene("bufferViews[", i, "].byteLength is ", view["byteLength"].get<std::uint64_t>(), " and ",
                       parsed->decoded_bytes(), " bytes are compressed in it");
    }
    BufferDeclaration& decoded = buffers.emplace_back();
    decoded.size_bytes = parsed->decoded_bytes();
    decoded.meshopt = *parsed;
    view["buffer"] = buffers.size() - 1;
    view["byteOffset"] = 0;
    view.erase("extensions");
  }
  return {};
}

// Moves each primitive's index accessor among its attributes.
void hide_indices(json& root) {
  if (!root.contains("meshes")) {
    return;
  }
  for (json& mesh : root["meshes"]) {
    for (json& primitive : mesh["primitives"]) {
      if (const auto it = primitive.find("indices"); it != primitive.end()) {
        primitive["attributes"][kIndicesAttribute] = *it;
        primitive.erase("indices");
      }
    }
  }
}

// Heap of tinygltf's model: its vectors grow by doubling, old and new side by side, so three times the elements.
std::uint64_t model_bytes(const json& root, const JsonMeasure& measure) {
  const auto size = [&](const char* section) -> std::uint64_t {
    return root.contains(section) ? root[section].size() : 0;
  };
  std::uint64_t primitives = 0;
  if (root.contains("meshes")) {
    for (const json& mesh : root["meshes"]) {
      primitives += mesh["primitives"].size();
    }
  }
  constexpr std::uint64_t kGrowth = 3;
  return kGrowth * (size("nodes") * sizeof(tinygltf::Node) + size("meshes") * sizeof(tinygltf::Mesh) +
                    size("accessors") * sizeof(tinygltf::Accessor) + size("scenes") * sizeof(tinygltf::Scene) +
                    size("bufferViews") * sizeof(tinygltf::BufferView) + size("cameras") * sizeof(tinygltf::Camera) +
                    primitives * (sizeof(tinygltf::Primitive) + 192)) +
         measure.values * 16 + measure.string_bytes;
}

struct JsonTree {
  BudgetReservation claim;
  JsonMeasure measure;
  json root;
};

Result<JsonTree> read_tree(const ByteSource& file, const GltfContainer& container, Ledger& ledger) {
  if (container.json.size_bytes > std::numeric_limits<std::uint32_t>::max()) {
    return Status(ErrorCode::unsupported, message("the JSON text has ", container.json.size_bytes,
                                                  " bytes; keep the buffers in a .bin file beside it"));
  }
  RAYMILL_ASSIGN_OR_RETURN(const BudgetReservation text_claim, ledger.claim(Tag::build, container.json.size_bytes));
  std::string text(container.json.size_bytes, '\0');
  RAYMILL_RETURN_IF_ERROR(file.read(container.json.offset, std::as_writable_bytes(std::span(text))));
  JsonTree tree;
  RAYMILL_ASSIGN_OR_RETURN(tree.measure, measure_json(text));
  RAYMILL_ASSIGN_OR_RETURN(tree.claim, ledger.claim(Tag::build, tree.measure.tree_bytes()));
  RAYMILL_ASSIGN_OR_RETURN(tree.root, parse_json(text));
  return tree;
}

// The normalised tree becomes text, and the text tinygltf's own tree, whose claim is the one of ours, and its model.
Status read_model(JsonTree tree, Ledger& ledger, tinygltf::Model& model) {
  constexpr std::uint64_t kLongestNumber = 26;
  constexpr std::uint64_t kLongestEscape = 6;
  RAYMILL_ASSIGN_OR_RETURN(
      BudgetReservation text_claim,
      ledger.claim(Tag::build, tree.measure.values * kLongestNumber + tree.measure.string_bytes * kLongestEscape));
  std::string text = tree.root.dump();
  tree.root = nullptr;
  if (text.size() > std::numeric_limits<std::uint32_t>::max()) {
    return {ErrorCode::unsupported,
            message("the structure alone takes ", text.size(), " bytes of JSON; split the file")};
  }
  text.shrink_to_fit();
  RAYMILL_RETURN_IF_ERROR(text_claim.resize(text.capacity()));
  std::string errors;
  std::string warnings;
  bool good = false;
  try {
    tinygltf::TinyGLTF parser;
    good = parser.LoadASCIIFromString(&model, &errors, &warnings, text.data(), static_cast<unsigned int>(text.size()),
                                      "", tinygltf::NO_REQUIRE);
  } catch (const std::exception& error) {
    errors = error.what();
  }
  if (!good) {
    std::replace(errors.begin(), errors.end(), '\n', ' ');
    return bad_scene("is not valid glTF 2.0: ", errors);
  }
  return {};
}

}  // namespace

GltfDocument::GltfDocument() : model_(std::make_unique<tinygltf::Model>()) {}
GltfDocument::GltfDocument(GltfDocument&&) noexcept = default;
GltfDocument& GltfDocument::operator=(GltfDocument&&) noexcept = default;
GltfDocument::~GltfDocument() = default;

int GltfDocument::indices_of(const tinygltf::Primitive& primitive) {
  const auto it = primitive.attributes.find(kIndicesAttribute);
  return it == primitive.attributes.end() ? -1 : it->second;
}

Result<GltfDocument> GltfDocument::load(const ByteSource& file, const GltfContainer& container, Ledger& ledger,
                                        const MaskRule& masks, AttributeSet attributes) {
  GltfDocument document;
  RAYMILL_ASSIGN_OR_RETURN(JsonTree tree, read_tree(file, container, ledger));
  if (masks.masks || masks.blend_cutoff || masks.one_side) {
    RAYMILL_ASSIGN_OR_RETURN(document.materials_, read_materials(tree.root, masks, ledger));
  }
  if (attributes != 0) {
    RAYMILL_ASSIGN_OR_RETURN(document.attribute_sources_, read_attribute_sources(tree.root, attributes, ledger));
  }
  RAYMILL_RETURN_IF_ERROR(normalize(tree.root));
  RAYMILL_RETURN_IF_ERROR(check_version(tree.root["asset"]));
  RAYMILL_ASSIGN_OR_RETURN(ExtensionUse extensions, check_extensions(tree.root));
  document.ignored_extensions_ = std::move(extensions.ignored);
  document.quantization_ = extensions.quantization;

  // The data: URIs leave the tree with claims of their own.
  document.buffers_ = take_buffer_declarations(tree.root);
  for (const BufferDeclaration& buffer : document.buffers_) {
    tree.measure.string_bytes -= buffer.uri.size();
  }
  RAYMILL_RETURN_IF_ERROR(tree.claim.resize(tree.measure.tree_bytes()));
  for (BufferDeclaration& buffer : document.buffers_) {
    RAYMILL_ASSIGN_OR_RETURN(buffer.uri_claim, ledger.claim(Tag::build, buffer.uri.capacity()));
  }

  const std::size_t declared = document.buffers_.size();
  RAYMILL_RETURN_IF_ERROR(take_meshopt_views(tree.root, document.buffers_));
  document.meshopt_views_ = document.buffers_.size() - declared;

  hide_indices(tree.root);
  tree.root.erase("skins");  // their number was needed, tinygltf wants more of them
  const std::uint64_t kept_bytes =
      model_bytes(tree.root, tree.measure) + document.buffers_.size() * sizeof(BufferDeclaration);
  RAYMILL_ASSIGN_OR_RETURN(document.claim_, ledger.claim(Tag::build, kept_bytes));
  RAYMILL_RETURN_IF_ERROR(read_model(std::move(tree), ledger, *document.model_));
  return document;
}

}  // namespace raymill::storage
