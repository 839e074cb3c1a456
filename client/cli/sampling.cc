#include "client/cli/sampling.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace raymill::client {

Surface surface_of(const Ray& ray, const Hit& hit) {
  constexpr float kOffset = 0x1p-18F;
  const float side = hit.normal[0] * ray.dir[0] + hit.normal[1] * ray.dir[1] + hit.normal[2] * ray.dir[2];
  const float sign = side > 0 ? -1.0F : 1.0F;
  Surface surface{};
  float largest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const float step = hit.t * ray.dir[axis];
    largest = std::max({largest, std::abs(ray.org[axis]), std::abs(step)});
    surface.origin[axis] = ray.org[axis] + step;
    surface.normal[axis] = sign * hit.normal[axis];
  }
  for (int axis = 0; axis < 3; ++axis) {
    surface.origin[axis] += kOffset * largest * surface.normal[axis];
  }
  return surface;
}

Vector3 cosine_direction(const Vector3& n, Random& random) {
  // Duff et al., Building an Orthonormal Basis, Revisited, JCGT 6(1), 2017.
  const float sign = std::copysign(1.0F, n[2]);
  const float a = -1.0F / (sign + n[2]);
  const float b = n[0] * n[1] * a;
  const Vector3 u{1.0F + sign * n[0] * n[0] * a, sign * b, -sign * n[0]};
  const Vector3 v{b, sign + n[1] * n[1] * a, -n[1]};
  const float s = random.unit(), angle = 2 * std::numbers::pi_v<float> * random.unit();
  const float r = std::sqrt(s), x = r * std::cos(angle), y = r * std::sin(angle), z = std::sqrt(1.0F - s);
  Vector3 direction{};
  for (int axis = 0; axis < 3; ++axis) {
    direction[axis] = x * u[axis] + y * v[axis] + z * n[axis];
  }
  return direction;
}

}  // namespace raymill::client
