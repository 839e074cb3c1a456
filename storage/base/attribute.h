// Attributes of triangles' corners that a store keeps on request: which there are, and how many numbers each has.
// Plain values; immutable. Normative: storage/ATTRIBUTES.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::storage {

/// In the order in which they stand wherever several do.
enum class Attribute : std::uint8_t { normal = 0, uv0 = 1, uv1 = 2, color0 = 3 };
constexpr std::size_t kAttributeCount = 4;
constexpr std::array kAttributes{Attribute::normal, Attribute::uv0, Attribute::uv1, Attribute::color0};

struct AttributeKind {
  std::string_view name;       ///< as `--attributes` takes it
  std::string_view gltf_name;  ///< of the primitive's attribute
  std::uint32_t floats = 0;    ///< of a corner
};
constexpr std::array<AttributeKind, kAttributeCount> kAttributeKinds{{
    {"normal", "NORMAL", 3},
    {"uv0", "TEXCOORD_0", 2},
    {"uv1", "TEXCOORD_1", 2},
    {"color0", "COLOR_0", 4},
}};
constexpr const AttributeKind& kind_of(Attribute attribute) {
  return kAttributeKinds[static_cast<std::size_t>(attribute)];
}

/// Attributes by their bits: bit i is attribute i.
using AttributeSet = std::uint32_t;
constexpr AttributeSet kAllAttributes = (1U << kAttributeCount) - 1;
constexpr AttributeSet bit_of(Attribute attribute) { return 1U << static_cast<unsigned>(attribute); }
constexpr bool holds(AttributeSet set, Attribute attribute) { return (set & bit_of(attribute)) != 0; }

/// Numbers of a corner with these attributes.
constexpr std::uint32_t corner_floats(AttributeSet set) {
  std::uint32_t floats = 0;
  for (const Attribute attribute : kAttributes) {
    floats += holds(set, attribute) ? kind_of(attribute).floats : 0;
  }
  return floats;
}
/// Where an attribute's numbers begin among those of a corner.
constexpr std::uint32_t first_float(AttributeSet set, Attribute attribute) {
  return corner_floats(set & (bit_of(attribute) - 1));
}
constexpr std::uint32_t kMostCornerFloats = corner_floats(kAllAttributes);
static_assert(kMostCornerFloats == 11);

/// Names with commas between them, to bits; each once, in any order. Errors: invalid_argument.
Result<AttributeSet> parse_attributes(std::string_view text);
/// "normal,uv0".
std::string to_string_of(AttributeSet set);

/// A value at the point (1-u-v) c0 + u c1 + v c2, in float64, each operation rounded once, from left to right.
inline double attribute_at(float c0, float c1, float c2, double u, double v) {
  return double(c0) + u * (double(c1) - double(c0)) + v * (double(c2) - double(c0));
}

/// Where a geometry's attributes are, and what takes its normals to the world.
struct AttributeGeometry {
  std::uint64_t first_entry = 0;     ///< of primitive 0; the others follow
  std::uint32_t triangle_count = 0;  ///< 0: it has none
  AttributeSet present = 0;          ///< those that it has, of the store's
  /// Column by column: the inverse transpose of its matrix times a positive number.
  std::array<std::array<float, 3>, 3> normal_columns{};
  std::uint32_t reserved = 0;
};
static_assert(sizeof(AttributeGeometry) == 56);

}  // namespace raymill::storage
