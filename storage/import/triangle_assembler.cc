#include "storage/import/triangle_assembler.h"

namespace raymill::storage {

Status TriangleAssembler::feed(std::span<const Vec3f> corners) {
  for (const Vec3f& corner : corners) {
    const std::uint64_t number = fed_++;
    const std::uint64_t in_list = mode_ == PrimitiveMode::triangles ? number % 3 : number;
    if (in_list < 2) {
      held_[in_list] = corner;
      continue;
    }
    switch (mode_) {
      case PrimitiveMode::triangle_strip: {
        // Triangle i of a strip is (i, i+1, i+2), or (i, i+2, i+1) where i is odd; here i = number - 2.
        const bool turned = number % 2 != 0;
        RAYMILL_RETURN_IF_ERROR(
            out_.add(turned ? std::array{held_[0], corner, held_[1]} : std::array{held_[0], held_[1], corner}));
        held_ = {held_[1], corner};
        break;
      }
      case PrimitiveMode::triangle_fan:
        RAYMILL_RETURN_IF_ERROR(out_.add({held_[1], corner, held_[0]}));
        held_[1] = corner;
        break;
      default:
        RAYMILL_RETURN_IF_ERROR(out_.add({held_[0], held_[1], corner}));
        break;
    }
  }
  return {};
}

std::uint64_t TriangleAssembler::leftover() const {
  if (mode_ == PrimitiveMode::triangles) {
    return fed_ % 3;
  }
  return fed_ < 3 ? fed_ : 0;
}

}  // namespace raymill::storage
