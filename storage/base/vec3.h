// Vec3f, Aabb, Triangle: plain geometry in world space (scene units). Immutable values.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace raymill::storage {

struct Vec3f {
  float x = 0, y = 0, z = 0;
  float operator[](int axis) const { return axis == 0 ? x : axis == 1 ? y : z; }
  float& operator[](int axis) { return axis == 0 ? x : axis == 1 ? y : z; }
  bool operator==(const Vec3f&) const = default;
};
static_assert(sizeof(Vec3f) == 12);

inline Vec3f min(const Vec3f& a, const Vec3f& b) {
  return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}
inline Vec3f max(const Vec3f& a, const Vec3f& b) {
  return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
}

/// Axis-aligned box; the default is empty (lower > upper) and is the neutral element of grow().
struct Aabb {
  Vec3f lower{std::numeric_limits<float>::infinity(), std::numeric_limits<float>::infinity(),
              std::numeric_limits<float>::infinity()};
  Vec3f upper{-std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity(),
              -std::numeric_limits<float>::infinity()};

  void grow(const Vec3f& p) {
    lower = min(lower, p);
    upper = max(upper, p);
  }
  void grow(const Aabb& b) {
    lower = min(lower, b.lower);
    upper = max(upper, b.upper);
  }
  [[nodiscard]] bool empty() const { return !(lower.x <= upper.x); }
  /// Half of the surface area in float64, 0 for the empty box.
  [[nodiscard]] double half_area() const {
    if (empty()) {
      return 0;
    }
    const double dx = double(upper.x) - lower.x, dy = double(upper.y) - lower.y, dz = double(upper.z) - lower.z;
    return dx * dy + dy * dz + dz * dx;
  }
  bool operator==(const Aabb&) const = default;
};

/// One triangle of the flattened scene: world-space corners in the input's order, and where it came from.
struct Triangle {
  std::array<Vec3f, 3> v;
  std::uint32_t geometry_id = 0;   ///< (node, primitive) pair in file order
  std::uint32_t primitive_id = 0;  ///< triangle in its primitive, before anything was dropped
};
static_assert(sizeof(Triangle) == 44);

inline Aabb bounds(const Triangle& t) {
  Aabb box;
  for (const Vec3f& p : t.v) {
    box.grow(p);
  }
  return box;
}

}  // namespace raymill::storage
