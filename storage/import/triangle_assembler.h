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

/// Of corners of any type, to whatever takes three of them: Status add(const std::array<Corner, 3>&).
template <typename Corner, typename Out>
class CornerAssembler {
 public:
  CornerAssembler(PrimitiveMode mode, Out& out) : mode_(mode), out_(out) {}

  /// Takes the next corners. Errors: those of `out`.
  Status feed(std::span<const Corner> corners) {
    for (const Corner& corner : corners) {
      const std::uint64_t number = fed_++;
      const std::uint64_t in_list = mode_ == PrimitiveMode::triangles ? number % 3 : number;
      if (in_list < 2) {
        held_[in_list] = corner;
        continue;
      }
      RAYMILL_RETURN_IF_ERROR(complete(corner, number));
    }
    return {};
  }
  /// Corners past the last whole triangle.
  [[nodiscard]] std::uint64_t leftover() const {
    return mode_ == PrimitiveMode::triangles ? fed_ % 3 : fed_ < 3 ? fed_ : 0;
  }

 private:
  Status complete(const Corner& corner, std::uint64_t number) {
    using Corners = std::array<Corner, 3>;
    const std::array<Corner, 2> held = held_;
    switch (mode_) {
      case PrimitiveMode::triangle_strip: {
        // Triangle i of a strip is (i, i+1, i+2), or (i, i+2, i+1) where i is odd; here i = number - 2.
        const bool turned = number % 2 != 0;
        held_ = {held[1], corner};
        return out_.add(turned ? Corners{held[0], corner, held[1]} : Corners{held[0], held[1], corner});
      }
      case PrimitiveMode::triangle_fan:
        held_[1] = corner;
        return out_.add(Corners{held[1], corner, held[0]});
      default:
        return out_.add(Corners{held[0], held[1], corner});
    }
  }

  const PrimitiveMode mode_;
  Out& out_;
  std::array<Corner, 2> held_{};  // list: the triangle's first two; strip: the last two; fan: the first and the last
  std::uint64_t fed_ = 0;
};

using TriangleAssembler = CornerAssembler<Vec3f, TriangleWriter>;

}  // namespace raymill::storage
