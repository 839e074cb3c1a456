#include "storage/base/placement.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace raymill::storage {

bool invertible(const Placement& m) {
  const auto length = [&m](std::size_t column) { return std::hypot(m[column], m[column + 1], m[column + 2]); };
  const double det = determinant(m);
  const double box = length(0) * length(3) * length(6);
  return std::all_of(m.begin(), m.end(), [](double x) { return std::isfinite(x); }) && std::isfinite(1 / det) &&
         std::isfinite(box) && std::abs(det) >= 0x1p-20 * box;
}

Aabb placed_box(const Placement& m, const Aabb& object) {
  // Two float32 roundings of what is added, and far more than float64 loses.
  constexpr double kSlack = 0x1p-23;
  Aabb box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double lower = m[9 + axis], upper = m[9 + axis], magnitude = std::abs(m[9 + axis]);
    for (std::size_t column = 0; column < 3; ++column) {
      const double a = m[column * 3 + axis] * object.lower[static_cast<int>(column)];
      const double b = m[column * 3 + axis] * object.upper[static_cast<int>(column)];
      lower += std::min(a, b);
      upper += std::max(a, b);
      magnitude += std::max(std::abs(a), std::abs(b));
    }
    const auto outward = [](double value, float limit) { return std::nextafter(static_cast<float>(value), limit); };
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    box.lower[static_cast<int>(axis)] = outward(lower - magnitude * kSlack, -kInfinity);
    box.upper[static_cast<int>(axis)] = outward(upper + magnitude * kSlack, kInfinity);
  }
  return box;
}

Aabb widened_for_rays(const Aabb& box, float reach) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const double by = double(reach) * 0x1p-22;
  Aabb wide;
  for (int axis = 0; axis < 3; ++axis) {
    wide.lower[axis] = std::nextafter(static_cast<float>(box.lower[axis] - by), -kInfinity);
    wide.upper[axis] = std::nextafter(static_cast<float>(box.upper[axis] + by), kInfinity);
  }
  return wide;
}

}  // namespace raymill::storage
