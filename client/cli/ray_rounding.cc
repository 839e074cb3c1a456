#include "client/cli/ray_rounding.h"

#include <cmath>
#include <limits>

namespace raymill::client {

namespace {

static_assert(std::numeric_limits<float>::is_iec559, "beyond the range a number becomes infinite");

constexpr float kInfinity = std::numeric_limits<float>::infinity();

float nearest(double value) { return static_cast<float>(value); }

float at_least(double value) {
  const float rounded = nearest(value);
  return double(rounded) < value ? std::nextafter(rounded, kInfinity) : rounded;
}

float at_most(double value) {
  const float rounded = nearest(value);
  return double(rounded) > value ? std::nextafter(rounded, -kInfinity) : rounded;
}

}  // namespace

Ray round_ray(const WideRay& ray) {
  Ray narrow{.org = {nearest(ray.org[0]), nearest(ray.org[1]), nearest(ray.org[2])},
             .tnear = at_least(ray.tnear),
             .dir = {nearest(ray.dir[0]), nearest(ray.dir[1]), nearest(ray.dir[2])},
             .tfar = at_most(ray.tfar)};
  if (narrow.tnear > narrow.tfar && ray.tnear <= ray.tfar) {
    narrow.tnear = nearest(ray.tnear);
    narrow.tfar = nearest(ray.tfar);
  }
  return narrow;
}

}  // namespace raymill::client
