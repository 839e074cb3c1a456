#include "storage/base/attribute.h"

namespace raymill::storage {

Result<AttributeSet> parse_attributes(std::string_view text) {
  AttributeSet set = 0;
  while (true) {
    const std::size_t comma = text.find(',');
    const std::string_view name = text.substr(0, comma);
    AttributeSet bit = 0;
    for (const Attribute attribute : kAttributes) {
      bit = name == kind_of(attribute).name ? bit_of(attribute) : bit;
    }
    if (bit == 0) {
      return {
          ErrorCode::invalid_argument,
          "attribute '" + std::string(name) + "' is none of those that a store keeps: " + to_string_of(kAllAttributes)};
    }
    set |= bit;
    if (comma == std::string_view::npos) {
      return set;
    }
    text = text.substr(comma + 1);
  }
}

std::string to_string_of(AttributeSet set) {
  std::string text;
  for (const Attribute attribute : kAttributes) {
    if (holds(set, attribute)) {
      text += text.empty() ? "" : ",";
      text += kind_of(attribute).name;
    }
  }
  return text;
}

}  // namespace raymill::storage
