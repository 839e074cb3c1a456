// Message: builds the one sentence of an import error from its parts. Immutable.
#pragma once

#include <concepts>
#include <cstdint>
#include <string>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::storage {

inline void append_part(std::string& text, std::string_view part) { text += part; }
inline void append_part(std::string& text, std::integral auto number) { text += std::to_string(number); }

/// The parts in a row; numbers in decimal.
template <typename... Parts>
std::string message(const Parts&... parts) {
  std::string text;
  (append_part(text, parts), ...);
  return text;
}

/// A broken rule of the scene's specification. The file's name is put before the sentence by import_gltf.
template <typename... Parts>
Status bad_scene(const Parts&... parts) {
  return {ErrorCode::bad_scene, message(parts...)};
}

/// The same error with `context` before its sentence.
inline Status in_context(std::string_view context, const Status& status) {
  return {status.code(), message(context, ": ", status.message())};
}

}  // namespace raymill::storage
