#include "client/cli/accuracy/tally.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>

namespace raymill::client {
namespace {

// Floats as whole numbers in their order: one step is one ulp.
std::int64_t place_of(float x) {
  const auto bits = std::bit_cast<std::uint32_t>(x);
  const auto magnitude = static_cast<std::int64_t>(bits & 0x7FFFFFFFu);
  return (bits >> 31) != 0 ? -magnitude : magnitude;
}

}  // namespace

Truth truth_of(const Ray& ray, const Hit& hit) {
  double squares = 0;
  for (const float component : ray.dir) {
    squares += double(component) * component;
  }
  return {hit.t, hit.geometry_id, hit.primitive_id, static_cast<float>(std::sqrt(squares))};
}

bool begins_inside(const Ray& ray, const Hit& hit) {
  constexpr double kClearOfEdges = 0x1p-20;   // in barycentrics; those of mode exact are off by less than 2^-22
  constexpr double kClearOfOrigin = 0x1p-18;  // of the largest coordinate, as surface_of() keeps it
  if (!std::isfinite(hit.t) || std::isfinite(ray.tfar)) {
    return false;
  }
  const double least = std::min({double(hit.u), double(hit.v), 1.0 - hit.u - hit.v});
  double facing = 0, squares = 0, largest = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    facing += double(ray.dir[axis]) * hit.normal[axis];
    squares += double(ray.dir[axis]) * ray.dir[axis];
    largest = std::max({largest, std::fabs(double(ray.org[axis])), std::fabs(hit.t * double(ray.dir[axis]))});
  }
  const double way = (double(hit.t) - ray.tnear) * std::sqrt(squares);
  return facing > 0 && least > kClearOfEdges && way > kClearOfOrigin * largest;
}

std::uint64_t ulps_between(float a, float b) {
  return static_cast<std::uint64_t>(std::llabs(place_of(a) - place_of(b)));
}

void Spread::add(double value) {
  // Sign, exponent and seven bits of the fraction: 128 steps from a power of two to the next.
  Step& step = steps_[static_cast<std::uint32_t>(std::bit_cast<std::uint64_t>(value) >> 45)];
  ++step.count;
  step.most = std::max(step.most, value);
  ++count_;
  most_ = std::max(most_, value);
}

double Spread::at(double share) const {
  const auto wanted = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(count_)));
  std::uint64_t passed = 0;
  for (const auto& [place, step] : steps_) {
    passed += step.count;
    if (passed >= wanted) {
      return step.most;
    }
  }
  return 0;
}

void Tally::add(const Truth& truth, const Hit& hit, bool inside, double bound) {
  ++rays_;
  if (std::isnan(truth.t)) {
    ++invalid_;
    return;
  }
  const bool should_hit = std::isfinite(truth.t), hits = std::isfinite(hit.t);
  oracle_hits_ += should_hit ? 1 : 0;
  proxy_hits_ += hits && hit.u == kProxyBarycentric ? 1 : 0;
  inside_ += inside ? 1 : 0;
  leaks_ += inside && !hits ? 1 : 0;
  if (should_hit != hits) {
    (should_hit ? wrong_misses_ : wrong_hits_) += 1;
    return;
  }
  if (!should_hit) {
    return;
  }
  const double units = std::fabs(double(hit.t) - truth.t) * truth.dir_length;
  if (units > bound) {
    ++wrong_surfaces_;
    return;
  }
  const bool same = hit.geometry_id == truth.geometry_id && hit.primitive_id == truth.primitive_id;
  wrong_primitives_ += !same && hit.t != truth.t ? 1 : 0;
  t_ulps_.add(static_cast<double>(ulps_between(hit.t, truth.t)));
  t_units_.add(units);
}

}  // namespace raymill::client
