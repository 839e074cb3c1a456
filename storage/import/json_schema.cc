#include "storage/import/json_schema.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "storage/import/message.h"

namespace raymill::storage {

namespace {

using nlohmann::json;

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
      return message("\"", value.get_ref<const std::string&>().substr(0, kLongest), "\"");
    default:
      return value.dump().substr(0, kLongest);
  }
}

class Normalizer {
 public:
  /// Takes down the lengths of the sections first: normalising moves them.
  Normalizer(const json& root, const JsonObject& schema) {
    for (const JsonField& field : schema.fields) {
      const auto section = root.find(field.key);
      section_sizes_[field.key] = section != root.end() && section->is_array() ? section->size() : 0;
    }
  }

  Status object(json& value, const JsonObject& schema) const {
    if (!value.is_object()) {
      return bad_scene(" is ", shown(value), "; an object is needed");
    }
    json kept = json::object();
    for (const JsonField& field : schema.fields) {
      const auto it = value.find(field.key);
      if (it == value.end()) {
        if (field.required) {
          return bad_scene(".", field.key, " is missing");
        }
        continue;
      }
      if (is_left_out(*it, field)) {
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
  static bool is_left_out(const json& value, const JsonField& field) {
    if (field.kind == FieldKind::bounds) {
      return !value.is_array() || value.size() != field.length ||
             !std::ranges::all_of(value, [](const json& element) { return element.is_number(); });
    }
    return field.kind == FieldKind::name && !value.is_string();
  }

  Status one(json& value, const JsonField& field) const {
    switch (field.kind) {
      case FieldKind::index:
        return index(value, field.target);
      case FieldKind::count:
        return whole(value, kCountMax);
      case FieldKind::bytes:
        return whole(value, kBytesMax);
      case FieldKind::integer:
        return whole(value, kIntegerMax);
      case FieldKind::stride:
        return stride(value);
      case FieldKind::element:
        return element_type(value);
      case FieldKind::number:
        return must(value.is_number(), value, "a number");
      case FieldKind::boolean:
        return must(value.is_boolean(), value, "true or false");
      case FieldKind::name:
      case FieldKind::text:
        return must(value.is_string(), value, "a string");
      case FieldKind::present:
        value = true;
        return {};
      case FieldKind::object:
        return object(value, *field.object);
      case FieldKind::bounds:
        return {};
      case FieldKind::numbers:
        if (value.is_array() && value.size() != field.length) {
          return bad_scene(" has ", value.size(), " numbers; it must have ", field.length);
        }
        [[fallthrough]];
      case FieldKind::indices:
      case FieldKind::texts:
      case FieldKind::objects:
        return elements(value, field);
    }
    return {};
  }

  Status elements(json& value, const JsonField& field) const {
    RAYMILL_RETURN_IF_ERROR(must(value.is_array(), value, "an array"));
    JsonField element = field;
    element.kind = field.kind == FieldKind::indices   ? FieldKind::index
                   : field.kind == FieldKind::numbers ? FieldKind::number
                   : field.kind == FieldKind::texts   ? FieldKind::text
                                                      : FieldKind::object;
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

  static Status stride(json& value) {
    constexpr std::uint64_t kStrideMax = 252;
    RAYMILL_RETURN_IF_ERROR(whole(value, kStrideMax));
    return must(value.get<std::uint64_t>() % 4 == 0, value, "a multiple of 4");
  }

  static Status element_type(const json& value) {
    constexpr std::string_view kTypes[] = {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"};
    const bool known =
        value.is_string() && std::ranges::find(kTypes, value.get_ref<const std::string&>()) != std::end(kTypes);
    return must(known, value, "SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4");
  }

  Status index(json& value, std::string_view target) const {
    RAYMILL_RETURN_IF_ERROR(whole(value, kIntegerMax));
    const std::size_t size = section_sizes_.at(target);
    if (value.get<std::uint64_t>() >= size) {
      return bad_scene(" is ", shown(value), " and the file has ", size == 0 ? "no" : std::to_string(size), " ",
                       target);
    }
    return {};
  }

  std::map<std::string_view, std::size_t> section_sizes_;
};

}  // namespace

Status apply_schema(json& root, const JsonObject& schema) {
  if (!root.is_object()) {
    return bad_scene("the JSON text is ", shown(root), "; an object is needed");
  }
  if (Status status = Normalizer(root, schema).object(root, schema); !status.ok()) {
    return {status.code(), status.message().substr(1)};  // the path's first dot
  }
  return {};
}

}  // namespace raymill::storage
