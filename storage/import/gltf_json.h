// GltfJson: JSON text into a tree, with its depth bounded and its memory claimed before it is built.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::storage {

/// What a text holds, known without building anything.
struct JsonMeasure {
  std::uint64_t values = 0;        ///< objects, arrays, members, elements
  std::uint64_t string_bytes = 0;  ///< keys and strings

  /// Upper bound of the heap of the tree: a member costs a map node of 112 bytes with its allocator header, an element
  /// at most twice its 16 bytes while its array grows; a string at most twice its length.
  [[nodiscard]] std::uint64_t tree_bytes() const { return values * 160 + string_bytes * 2; }
};

/// Errors: bad_scene (not JSON, or nested deeper than any glTF is).
Result<JsonMeasure> measure_json(std::string_view text);

/// Parses what measure_json() accepted. Errors: bad_scene.
Result<nlohmann::json> parse_json(std::string_view text);

}  // namespace raymill::storage
