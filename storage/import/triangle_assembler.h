// TriangleAssembler: corners in a row become triangles: list, strip or fan (glTF 2.0, 3.7.2.1).
//
//   list   (0 1 2) (3 4 5) ...
//   strip  (0 1 2) (1 3 2) (2 3 4) (3 5 4) ...   every second one turned, so that all wind the same way
//   fan    (1 2 0) (2 3 0) (3 4 0) ...
// Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "storage/import/triangle_filter.h"

namespace raymill::storage {

enum class PrimitiveMode : std::uint8_t {
  points = 0,
  lines = 1,
  line_loop = 2,
  line_strip = 3,
  triangles = 4,
  triangle_strip = 5,
  triangle_fan = 6,
};

class TriangleAssembler {
 public:
  TriangleAssembler(PrimitiveMode mode, TriangleWriter& out) : mode_(mode), out_(out) {}

  /// Takes the next corners. Errors: the sink's.
  Status feed(std::span<const Vec3f> corners);
  /// Corners past the last whole triangle.
  [[nodiscard]] std::uint64_t leftover() const;

 private:
  const PrimitiveMode mode_;
  TriangleWriter& out_;
  std::array<Vec3f, 2> held_;  // list: the triangle's first two; strip: the last two; fan: the first and the last
  std::uint64_t fed_ = 0;
};

}  // namespace raymill::storage
