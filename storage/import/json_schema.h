// JsonSchema: tables that say which fields of a JSON document are read, of what type and in what range.
//
// Applying one keeps the fields that it lists and removes the others; what is kept can be read without further checks.
// Immutable tables; thread-safe.
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::storage {

enum class FieldKind {
  index,    // of an element of the section `target`
  indices,  // array of such
  count,    // elements: fits the 32-bit ids of the output
  bytes,    // offsets and lengths: exact in a JSON number
  integer,  // ids and enumerations: 0 .. 2^31 - 1
  stride,   // a multiple of 4 up to 252
  element,  // SCALAR, VEC3, ...
  number,
  numbers,  // array of `length`
  bounds,   // the same, and left out where it is anything else
  boolean,
  text,
  texts,    // array of strings
  name,     // text, and left out where it is anything else
  present,  // only whether it is there matters: becomes true
  object,   // `object`
  objects,  // array of `object`
};

struct JsonObject;

struct JsonField {
  std::string_view key;
  FieldKind kind;
  bool required = false;
  std::string_view target = {};
  const JsonObject* object = nullptr;
  std::size_t length = 0;
};

struct JsonObject {
  std::span<const JsonField> fields;
};

/// Applies `schema` to `root` in place. `target` of an index names an array of the root object.
/// Errors: bad_scene, with the path of the field ("accessors[3].count is -1; ...").
Status apply_schema(nlohmann::json& root, const JsonObject& schema);

}  // namespace raymill::storage
