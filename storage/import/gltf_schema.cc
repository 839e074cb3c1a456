#include "storage/import/gltf_schema.h"

#include <nlohmann/json.hpp>

#include "storage/import/json_schema.h"

namespace raymill::storage {

namespace {

using Kind = FieldKind;

constexpr JsonField kSparseIndicesFields[] = {
    {"bufferView", Kind::index, true, "bufferViews"},
    {"byteOffset", Kind::integer},
    {"componentType", Kind::integer, true},
};
constexpr JsonObject kSparseIndices{kSparseIndicesFields};

constexpr JsonField kSparseValuesFields[] = {
    {"bufferView", Kind::index, true, "bufferViews"},
    {"byteOffset", Kind::integer},
};
constexpr JsonObject kSparseValues{kSparseValuesFields};

constexpr JsonField kSparseFields[] = {
    {"count", Kind::integer, true},
    {"indices", Kind::object, true, {}, &kSparseIndices},
    {"values", Kind::object, true, {}, &kSparseValues},
};
constexpr JsonObject kSparse{kSparseFields};

constexpr JsonField kAccessorFields[] = {
    {"bufferView", Kind::index, false, "bufferViews"},
    {"byteOffset", Kind::bytes},
    {"componentType", Kind::integer, true},
    {"normalized", Kind::boolean},
    {"count", Kind::count, true},
    {"type", Kind::element, true},
    {"min", Kind::bounds, false, {}, nullptr, 3},
    {"max", Kind::bounds, false, {}, nullptr, 3},
    {"sparse", Kind::object, false, {}, &kSparse},
};
constexpr JsonObject kAccessor{kAccessorFields};

constexpr JsonField kMeshoptFields[] = {
    {"buffer", Kind::index, true, "buffers"},
    {"byteOffset", Kind::bytes},
    {"byteLength", Kind::bytes, true},
    {"byteStride", Kind::integer, true},
    {"count", Kind::count, true},
    {"mode", Kind::text, true},
    {"filter", Kind::text},
};
constexpr JsonObject kMeshopt{kMeshoptFields};

constexpr JsonField kBufferViewExtensionsFields[] = {{"EXT_meshopt_compression", Kind::object, false, {}, &kMeshopt}};
constexpr JsonObject kBufferViewExtensions{kBufferViewExtensionsFields};

constexpr JsonField kBufferViewFields[] = {
    {"buffer", Kind::index, true, "buffers"},
    {"byteOffset", Kind::bytes},
    {"byteLength", Kind::bytes, true},
    {"byteStride", Kind::stride},
    {"extensions", Kind::object, false, {}, &kBufferViewExtensions},
};
constexpr JsonObject kBufferView{kBufferViewFields};

constexpr JsonField kBufferExtensionsFields[] = {{"EXT_meshopt_compression", Kind::present}};
constexpr JsonObject kBufferExtensions{kBufferExtensionsFields};

constexpr JsonField kBufferFields[] = {
    {"uri", Kind::text},
    {"byteLength", Kind::bytes, true},
    {"extensions", Kind::object, false, {}, &kBufferExtensions},
};
constexpr JsonObject kBuffer{kBufferFields};

constexpr JsonField kDracoAttributesFields[] = {{"POSITION", Kind::integer}};
constexpr JsonObject kDracoAttributes{kDracoAttributesFields};

constexpr JsonField kDracoFields[] = {
    {"bufferView", Kind::index, true, "bufferViews"},
    {"attributes", Kind::object, true, {}, &kDracoAttributes},
};
constexpr JsonObject kDraco{kDracoFields};

constexpr JsonField kPrimitiveExtensionsFields[] = {{"KHR_draco_mesh_compression", Kind::object, false, {}, &kDraco}};
constexpr JsonObject kPrimitiveExtensions{kPrimitiveExtensionsFields};

constexpr JsonField kAttributesFields[] = {{"POSITION", Kind::index, false, "accessors"}};
constexpr JsonObject kPrimitiveAttributes{kAttributesFields};

constexpr JsonObject kMorphTarget{};

constexpr JsonField kPrimitiveFields[] = {
    {"attributes", Kind::object, true, {}, &kPrimitiveAttributes},
    {"indices", Kind::index, false, "accessors"},
    {"mode", Kind::integer},
    {"targets", Kind::objects, false, {}, &kMorphTarget},
    {"extensions", Kind::object, false, {}, &kPrimitiveExtensions},
};
constexpr JsonObject kPrimitive{kPrimitiveFields};

constexpr JsonField kMeshFields[] = {
    {"name", Kind::name},
    {"primitives", Kind::objects, true, {}, &kPrimitive},
};
constexpr JsonObject kMesh{kMeshFields};

constexpr JsonField kInstancingAttributesFields[] = {
    {"TRANSLATION", Kind::index, false, "accessors"},
    {"ROTATION", Kind::index, false, "accessors"},
    {"SCALE", Kind::index, false, "accessors"},
};
constexpr JsonObject kInstancingAttributes{kInstancingAttributesFields};

constexpr JsonField kInstancingFields[] = {{"attributes", Kind::object, true, {}, &kInstancingAttributes}};
constexpr JsonObject kInstancing{kInstancingFields};

constexpr JsonField kNodeExtensionsFields[] = {{"EXT_mesh_gpu_instancing", Kind::object, false, {}, &kInstancing}};
constexpr JsonObject kNodeExtensions{kNodeExtensionsFields};

constexpr JsonField kNodeFields[] = {
    {"name", Kind::name},
    {"camera", Kind::index, false, "cameras"},
    {"extensions", Kind::object, false, {}, &kNodeExtensions},
    {"children", Kind::indices, false, "nodes"},
    {"matrix", Kind::numbers, false, {}, nullptr, 16},
    {"mesh", Kind::index, false, "meshes"},
    {"rotation", Kind::numbers, false, {}, nullptr, 4},
    {"scale", Kind::numbers, false, {}, nullptr, 3},
    {"skin", Kind::index, false, "skins"},
    {"translation", Kind::numbers, false, {}, nullptr, 3},
};
constexpr JsonObject kNode{kNodeFields};

constexpr JsonField kSceneFields[] = {{"name", Kind::name}, {"nodes", Kind::indices, false, "nodes"}};
constexpr JsonObject kScene{kSceneFields};

constexpr JsonField kPerspectiveFields[] = {
    {"aspectRatio", Kind::number},
    {"yfov", Kind::number, true},
    {"zfar", Kind::number},
    {"znear", Kind::number, true},
};
constexpr JsonObject kPerspective{kPerspectiveFields};

constexpr JsonField kOrthographicFields[] = {
    {"xmag", Kind::number, true},
    {"ymag", Kind::number, true},
    {"zfar", Kind::number, true},
    {"znear", Kind::number, true},
};
constexpr JsonObject kOrthographic{kOrthographicFields};

constexpr JsonField kCameraFields[] = {
    {"name", Kind::name},
    {"orthographic", Kind::object, false, {}, &kOrthographic},
    {"perspective", Kind::object, false, {}, &kPerspective},
    {"type", Kind::text, true},
};
constexpr JsonObject kCamera{kCameraFields};

constexpr JsonField kAssetFields[] = {{"version", Kind::text, true}, {"minVersion", Kind::text}};
constexpr JsonObject kAsset{kAssetFields};

constexpr JsonObject kSkin{};

// Sections that are pointed into stand here even where nothing of their elements is read: their length is.
constexpr JsonField kRootFields[] = {
    {"asset", Kind::object, true, {}, &kAsset},
    {"extensionsUsed", Kind::texts},
    {"extensionsRequired", Kind::texts},
    {"buffers", Kind::objects, false, {}, &kBuffer},
    {"bufferViews", Kind::objects, false, {}, &kBufferView},
    {"accessors", Kind::objects, false, {}, &kAccessor},
    {"meshes", Kind::objects, false, {}, &kMesh},
    {"nodes", Kind::objects, false, {}, &kNode},
    {"skins", Kind::objects, false, {}, &kSkin},
    {"cameras", Kind::objects, false, {}, &kCamera},
    {"scenes", Kind::objects, false, {}, &kScene},
    {"scene", Kind::index, false, "scenes"},
};
constexpr JsonObject kRoot{kRootFields};

}  // namespace

Status normalize(nlohmann::json& root) { return apply_schema(root, kRoot); }

}  // namespace raymill::storage
