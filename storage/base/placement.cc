#include "storage/base/placement.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace raymill::storage {

namespace {

// What float32 rays may be stretched by on their way into an object, and shrunk by. A test of a triangle multiplies
// dir, the way to the triangle and an edge: 2^40 |dir|, 2^40 times the way in the world, and the edge in the object
// have room for a way of 2^40 and an edge of 2^6 below 2^127. Shrunk by 2^60, a product of dir and two edges of 2^-16
// is no denormal.
constexpr double kMostStretchOfRays = 0x1p+40, kMostShrinkOfRays = 0x1p+60;

}  // namespace

bool invertible(const Placement& m) {
  const auto length = [](double x, double y, double z) { return std::hypot(x, y, z); };
  const double det = determinant(m);
  double box = 1;
  bool in_range = std::all_of(m.begin(), m.end(), [](double x) { return std::isfinite(x); });
  for (std::size_t i = 0; i < 9; i += 3) {
    const std::size_t a = (i + 3) % 9, b = (i + 6) % 9;
    const double column = length(m[i], m[i + 1], m[i + 2]);
    // A row of the inverse is the product of the other two columns over the determinant.
    const double row = length(m[a + 1] * m[b + 2] - m[a + 2] * m[b + 1], m[a + 2] * m[b] - m[a] * m[b + 2],
                              m[a] * m[b + 1] - m[a + 1] * m[b]) /
                       std::abs(det);
    box *= column;
    in_range = in_range && column <= kMostShrinkOfRays && row <= kMostStretchOfRays;
  }
  return in_range && std::abs(det) >= 0x1p-20 * box;
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
