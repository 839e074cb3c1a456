#include "storage/import/gltf_schema.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>

#include "storage/import/message.h"

namespace raymill::storage {

namespace {

using nlohmann::json;

enum class Kind {
  index,    // of an element of the section `target`
  indices,  // array of such
  count,    // elements: fits the 32-bit ids of the output
  bytes,    // offsets and lengths: exact in a JSON number
  integer,  // ids and enumerations: 0 .. 2^31 - 1
  number,
  numbers,  // array of `length`
  boolean,
  text,
  texts,    // array of strings
  name,     // text, and left out where it is anything else
  present,  // only whether it is there matters: becomes true
  object,   // `object`
  objects,  // array of `object`
};

struct Object;

struct Field {
  std::string_view key;
  Kind kind;
  bool required = false;
  std::string_view target = {};
  const Object* object = nullptr;
  std::size_t length = 0;
};

struct Object {
  std::span<const Field> fields;
};

constexpr Field kSparseIndicesFields[] = {
    {"bufferView", Kind::index, true, "bufferViews"},
    {"byteOffset", Kind::integer},
    {"componentType", Kind::integer, true},
};
constexpr Object kSparseIndices{kSparseIndicesFields};

constexpr Field kSparseValuesFields[] = {
    {"bufferView", Kind::index, true, "bufferViews"},
    {"byteOffset", Kind::integer},
};
constexpr Object kSparseValues{kSparseValuesFields};

constexpr Field kSparseFields[] = {
    {"count", Kind::integer, true},
    {"indices", Kind::object, true, {}, &kSparseIndices},
    {"values", Kind::object, true, {}, &kSparseValues},
};
constexpr Object kSparse{kSparseFields};

constexpr Field kAccessorFields[] = {
    {"bufferView", Kind::index, false, "bufferViews"},
    {"byteOffset", Kind::bytes},
    {"componentType", Kind::integer, true},
    {"normalized", Kind::boolean},
    {"count", Kind::count, true},
    {"type", Kind::text, true},
    {"sparse", Kind::object, false, {}, &kSparse},
};
constexpr Object kAccessor{kAccessorFields};

constexpr Field kBufferViewFields[] = {
    {"buffer", Kind::index, true, "buffers"},
    {"byteOffset", Kind::bytes},
    {"byteLength", Kind::bytes, true},
    {"byteStride", Kind::integer},
};
constexpr Object kBufferView{kBufferViewFields};

constexpr Field kBufferExtensionsFields[] = {{"EXT_meshopt_compression", Kind::present}};
constexpr Object kBufferExtensions{kBufferExtensionsFields};

constexpr Field kBufferFields[] = {
    {"uri", Kind::text},
    {"byteLength", Kind::bytes, true},
    {"extensions", Kind::object, false, {}, &kBufferExtensions},
};
constexpr Object kBuffer{kBufferFields};

constexpr Field kDracoAttributesFields[] = {{"POSITION", Kind::integer}};
constexpr Object kDracoAttributes{kDracoAttributesFields};

constexpr Field kDracoFields[] = {
    {"bufferView", Kind::index, true, "bufferViews"},
    {"attributes", Kind::object, true, {}, &kDracoAttributes},
};
constexpr Object kDraco{kDracoFields};

constexpr Field kPrimitiveExtensionsFields[] = {{"KHR_draco_mesh_compression", Kind::object, false, {}, &kDraco}};
constexpr Object kPrimitiveExtensions{kPrimitiveExtensionsFields};

constexpr Field kAttributesFields[] = {{"POSITION", Kind::index, false, "accessors"}};
constexpr Object kAttributes{kAttributesFields};

constexpr Object kMorphTarget{};

constexpr Field kPrimitiveFields[] = {
    {"attributes", Kind::object, true, {}, &kAttributes},
    {"indices", Kind::index, false, "accessors"},
    {"mode", Kind::integer},
    {"targets", Kind::objects, false, {}, &kMorphTarget},
    {"extensions", Kind::object, false, {}, &kPrimitiveExtensions},
};
constexpr Object kPrimitive{kPrimitiveFields};

constexpr Field kMeshFields[] = {
    {"name", Kind::name},
    {"primitives", Kind::objects, true, {}, &kPrimitive},
};
constexpr Object kMesh{kMeshFields};

constexpr Field kNodeFields[] = {
    {"name", Kind::name},
    {"camera", Kind::index, false, "cameras"},
    {"children", Kind::indices, false, "nodes"},
    {"matrix", Kind::numbers, false, {}, nullptr, 16},
    {"mesh", Kind::index, false, "meshes"},
    {"rotation", Kind::numbers, false, {}, nullptr, 4},
    {"scale", Kind::numbers, false, {}, nullptr, 3},
    {"skin", Kind::index, false, "skins"},
    {"translation", Kind::numbers, false, {}, nullptr, 3},
};
constexpr Object kNode{kNodeFields};

constexpr Field kSceneFields[] = {{"name", Kind::name}, {"nodes", Kind::indices, false, "nodes"}};
constexpr Object kScene{kSceneFields};

constexpr Field kPerspectiveFields[] = {
    {"aspectRatio", Kind::number},
    {"yfov", Kind::number, true},
    {"zfar", Kind::number},
    {"znear", Kind::number, true},
};
constexpr Object kPerspective{kPerspectiveFields};

constexpr Field kOrthographicFields[] = {
    {"xmag", Kind::number, true},
    {"ymag", Kind::number, true},
    {"zfar", Kind::number, true},
    {"znear", Kind::number, true},
};
constexpr Object kOrthographic{kOrthographicFields};

constexpr Field kCameraFields[] = {
    {"name", Kind::name},
    {"orthographic", Kind::object, false, {}, &kOrthographic},
    {"perspective", Kind::object, false, {}, &kPerspective},
    {"type", Kind::text, true},
};
constexpr Object kCamera{kCameraFields};

constexpr Field kAssetFields[] = {{"version", Kind::text, true}, {"minVersion", Kind::text}};
constexpr Object kAsset{kAssetFields};

constexpr Object kSkin{};

// Sections that are pointed into stand here even where nothing of their elements is read: their length is.
constexpr Field kRootFields[] = {
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
constexpr Object kRoot{kRootFields};

constexpr std::uint64_t kCountMax = std::numeric_limits<std::uint32_t>::max();
constexpr std::uint64_t kBytesMax = std::uint64_t{1} << 53;
constexpr std::uint64_t kIntegerMax = std::numeric_limits<std::int32_t>::max();

// The messages below start at the point where the path of the field ends: " is ...", or ".key" and "[i]" while the
// path is put together on the way out.

std::string shown(const json& value) {
  constexpr std::size_t kLongest = 40;
  switch (value.type()) {
    case json::value_t::object:
      return "an object";
    case json::value_t::array:
      return "an array";
    case json::value_t::string:
      return "a string";
    default:
      return value.dump().substr(0, kLongest);
  }
}

class Normalizer {
 public:
  /// Takes down the lengths of the sections first: normalising moves them.
  explicit Normalizer(const json& root) {
    for (const Field& field : kRootFields) {
      const auto section = root.find(field.key);
      section_sizes_[field.key] = section != root.end() && section->is_array() ? section->size() : 0;
    }
  }

  Status object(json& value, const Object& schema) const {
    if (!value.is_object()) {
      return bad_scene(" is ", shown(value), "; an object is needed");
    }
    json kept = json::object();
    for (const Field& field : schema.fields) {
      const auto it = value.find(field.key);
      if (it == value.end()) {
        if (field.required) {
          return bad_scene(".", field.key, " is missing");
        }
        continue;
      }
      if (field.kind == Kind::name && !it->is_string()) {
        continue;
      }
      if (Status status = one(*it, field); !status.ok()) {
        return {status.code(), message(".", field.key, status.message())};
      }
      kept[std::string(field.key)] = std::move(*it);
    }
    value = std::move(kept);
    return {};
  }

 private:
  Status one(json& value, const Field& field) const {
    switch (field.kind) {
      case Kind::index:
        return index(value, field.target);
      case Kind::count:
        return whole(value, kCountMax);
      case Kind::bytes:
        return whole(value, kBytesMax);
      case Kind::integer:
        return whole(value, kIntegerMax);
      case Kind::number:
        return must(value.is_number(), value, "a number");
      case Kind::boolean:
        return must(value.is_boolean(), value, "true or false");
      case Kind::name:
      case Kind::text:
        return must(value.is_string(), value, "a string");
      case Kind::present:
        value = true;
        return {};
      case Kind::object:
        return object(value, *field.object);
      case Kind::numbers:
        if (value.is_array() && value.size() != field.length) {
          return bad_scene(" has ", value.size(), " numbers; it must have ", field.length);
        }
        [[fallthrough]];
      case Kind::indices:
      case Kind::texts:
      case Kind::objects:
        return elements(value, field);
    }
    return {};
  }

  Status elements(json& value, const Field& field) const {
    RAYMILL_RETURN_IF_ERROR(must(value.is_array(), value, "an array"));
    Field element = field;
    element.kind = field.kind == Kind::indices   ? Kind::index
                   : field.kind == Kind::numbers ? Kind::number
                   : field.kind == Kind::texts   ? Kind::text
                                                 : Kind::object;
    for (std::size_t i = 0; i < value.size(); ++i) {
      if (Status status = one(value[i], element); !status.ok()) {
        return {status.code(), message("[", i, "]", status.message())};
      }
    }
    return {};
  }

  static Status must(bool holds, const json& value, std::string_view needed) {
    return holds ? Status() : bad_scene(" is ", shown(value), "; ", needed, " is needed");
  }

  static Status whole(json& value, std::uint64_t most) {
    if (value.is_number_float()) {
      const double number = value.get<double>();
      if (number >= 0 && number <= static_cast<double>(most) && number == std::floor(number)) {
        value = static_cast<std::uint64_t>(number);
      }
    }
    if (!value.is_number_unsigned() || value.get<std::uint64_t>() > most) {
      return bad_scene(" is ", shown(value), "; a whole number from 0 to ", most, " is needed");
    }
    return {};
  }

  Status index(json& value, std::string_view target) const {
    RAYMILL_RETURN_IF_ERROR(whole(value, kIntegerMax));
    const std::size_t size = section_sizes_.at(target);
    if (value.get<std::uint64_t>() >= size) {
      return bad_scene(" is ", shown(value), "; there are only ", size, " ", target);
    }
    return {};
  }

  std::map<std::string_view, std::size_t> section_sizes_;
};

}  // namespace

Status normalize(json& root) {
  if (!root.is_object()) {
    return bad_scene("the JSON text is ", shown(root), "; an object is needed");
  }
  const Normalizer normalizer(root);
  if (Status status = normalizer.object(root, kRoot); !status.ok()) {
    return {status.code(), status.message().substr(1)};
  }
  return {};
}

}  // namespace raymill::storage
