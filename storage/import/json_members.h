// What a document that nobody has checked yet may hold: members of JSON, null where there are none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>

namespace raymill::storage {

inline const nlohmann::json& member(const nlohmann::json& object, const char* key) {
  static const nlohmann::json kNone;
  if (!object.is_object()) {
    return kNone;
  }
  const auto it = object.find(key);
  return it == object.end() ? kNone : *it;
}

inline std::size_t size_of(const nlohmann::json& section) { return section.is_array() ? section.size() : 0; }

/// An index below `size`, or -1 where it is none.
inline int index_below(const nlohmann::json& value, std::size_t size) {
  return value.is_number_unsigned() && value.get<std::uint64_t>() < size ? static_cast<int>(value.get<std::uint64_t>())
                                                                         : -1;
}

}  // namespace raymill::storage
