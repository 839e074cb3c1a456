// GltfJson: JSON text into a tree, with its depth bounded and its memory claimed before it is built.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::storage {

/// What a text holds, known without building anything.
struct JsonMeasure {
  std::uint64_t values = 0;
  std::uint64_t members = 0;       ///< values that have a key
  std::uint64_t blocks = 0;        ///< values with a heap block of their own: objects, arrays, strings
  std::uint64_t string_bytes = 0;  ///< of keys and strings

  /// Upper bound of the heap of the tree while it is parsed. An element takes 16 bytes in an array that doubles; a
  /// member's map node 80 and a block's object up to 48, each with 16 of the allocator; a string stands in the lexer's
  /// buffer, which doubles, and in the tree.
  [[nodiscard]] std::uint64_t tree_bytes() const {
    return (values - members) * 32 + members * 96 + blocks * 64 + string_bytes * 3;
  }
};

/// Errors: bad_scene (not JSON, or nested deeper than any glTF is).
Result<JsonMeasure> measure_json(std::string_view text);

/// Parses what measure_json() accepted. Errors: bad_scene.
Result<nlohmann::json> parse_json(std::string_view text);

}  // namespace raymill::storage
