#include "storage/import/transform.h"

#include <algorithm>

namespace raymill::storage {

Placement placement_of(const Transform& transform) {
  Placement placement{};
  for (std::size_t column = 0; column < 4; ++column) {
    for (std::size_t row = 0; row < 3; ++row) {
      placement[column * 3 + row] = transform.m[column * 4 + row];
    }
  }
  return placement;
}

Transform from_trs(const Vec3d& translation, const std::array<double, 4>& rotation, const Vec3d& scale) {
  // Turned to a length near one by a power of two, which changes no digit: squares neither overflow nor vanish.
  const double largest =
      std::max({std::abs(rotation[0]), std::abs(rotation[1]), std::abs(rotation[2]), std::abs(rotation[3])});
  const int exponent = largest > 0 && std::isfinite(largest) ? std::ilogb(largest) : 0;
  const double x = std::scalbn(rotation[0], -exponent), y = std::scalbn(rotation[1], -exponent),
               z = std::scalbn(rotation[2], -exponent), w = std::scalbn(rotation[3], -exponent);
  const double norm = x * x + y * y + z * z + w * w;
  const double s = norm > 0 ? 2 / norm : 0;
  const double turned[9] = {1 - s * (y * y + z * z), s * (x * y + z * w),     s * (x * z - y * w),
                            s * (x * y - z * w),     1 - s * (x * x + z * z), s * (y * z + x * w),
                            s * (x * z + y * w),     s * (y * z - x * w),     1 - s * (x * x + y * y)};
  const double scales[3] = {scale.x, scale.y, scale.z};
  const double moved[3] = {translation.x, translation.y, translation.z};
  Transform transform;
  for (std::size_t column = 0; column < 3; ++column) {
    for (std::size_t row = 0; row < 3; ++row) {
      transform.m[column * 4 + row] = turned[column * 3 + row] * scales[column];
    }
    transform.m[12 + column] = moved[column];
  }
  return transform;
}

}  // namespace raymill::storage
