// PlyHeader: the text at the start of a PLY file (Turk 1994), which says what the rest is made of. Immutable.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/status.h"
#include "storage/import/byte_source.h"

namespace raymill::storage {

enum class PlyType : std::uint8_t { int8, uint8, int16, uint16, int32, uint32, float32, float64 };
std::uint32_t size_bytes(PlyType type);
inline bool is_integer(PlyType type) { return type < PlyType::float32; }

enum class PlyEncoding : std::uint8_t { text, little_endian, big_endian };

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::float32;
  std::optional<PlyType> list_count = {};  ///< of a list: what its length is written as
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  /// The property of that name; nothing where there is none.
  [[nodiscard]] const PlyProperty* find(std::string_view property) const;
  [[nodiscard]] bool has_lists() const;
  /// Bytes that a row takes at least, exactly so for a binary one without lists.
  [[nodiscard]] std::uint64_t least_row_bytes(PlyEncoding encoding) const;
};

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::text;
  std::vector<PlyElement> elements;
  std::uint64_t body_offset = 0;
};

/// The header at the start of `file`, which begins with "ply". Every element's rows are known to fit into the file.
/// Errors: bad_scene, unsupported (another version of the format), io.
Result<PlyHeader> read_ply_header(const ByteSource& file);

}  // namespace raymill::storage
