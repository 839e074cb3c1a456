#include "traversal/ray_rounding.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace raymill::traversal {

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

// a - b, all of it: the difference in float64 and its error, by Knuth's two-sum.
struct Difference {
  double high, low;
};

Difference exact_difference(double a, double b) {
  const double high = a - b;
  const double back = high - a;
  return {high, (a - (high - back)) - (b + back)};
}

// a - b, rounded once. Rounded to odd (Boldo and Melquiond 2008), the nearest float32 of it is that of the exact
// difference: float64 has 29 bits more, and two would do.
float difference(double a, double b) {
  const auto [high, low] = exact_difference(a, b);
  const bool is_inexact = low != 0 && std::isfinite(low);
  const bool is_even = (std::bit_cast<std::uint64_t>(high) & 1) == 0;
  return nearest(is_inexact && is_even ? std::nextafter(high, std::copysign(HUGE_VAL, low)) : high);
}

// high - near is exact: near has the leading digits of high.
float rest_of_difference(double a, double b) {
  const auto [high, low] = exact_difference(a, b);
  const float rest = nearest((high - double(difference(a, b))) + low);
  return std::isfinite(rest) ? rest : 0.0F;
}

std::array<float, 3> differences(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return {difference(a[0], b[0]), difference(a[1], b[1]), difference(a[2], b[2])};
}

}  // namespace

std::array<float, 3> rest_of_org(const std::array<double, 3>& org, const std::array<double, 3>& origin) {
  return {rest_of_difference(org[0], origin[0]), rest_of_difference(org[1], origin[1]),
          rest_of_difference(org[2], origin[2])};
}

Ray moved_ray(const Ray& ray, const std::array<double, 3>& origin) {
  Ray moved = ray;
  moved.org = differences({ray.org[0], ray.org[1], ray.org[2]}, origin);
  return moved;
}

Ray round_ray(const Ray64& ray, const std::array<double, 3>& origin) {
  Ray narrow{.org = differences(ray.org, origin),
             .tnear = at_least(ray.tnear),
             .dir = {nearest(ray.dir[0]), nearest(ray.dir[1]), nearest(ray.dir[2])},
             .tfar = at_most(ray.tfar)};
  if (narrow.tnear > narrow.tfar && ray.tnear <= ray.tfar) {
    narrow.tnear = nearest(ray.tnear);
    narrow.tfar = nearest(ray.tfar);
  }
  return narrow;
}

}  // namespace raymill::traversal
