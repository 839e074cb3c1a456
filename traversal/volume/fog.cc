#include "traversal/volume/fog.h"

#include <bit>
#include <cmath>

#include "traversal/volume/volume_math.h"

namespace raymill::traversal {

double integrate(const BrickCells& cells, const Interval& in) {
  constexpr double kGaussPoint = 0.5773502691896257;  // 1 / sqrt 3
  double sum = 0;
  cells.each(in, [&](const Cell& cell, double begin, double end) {
    const auto corners = cells.corners(cell);
    const double half = 0.5 * (end - begin), middle = begin + half;
    sum += half * (BrickCells::trilinear(corners, cells.place(cell, middle - half * kGaussPoint)) +
                   BrickCells::trilinear(corners, cells.place(cell, middle + half * kGaussPoint)));
    return true;
  });
  return sum;
}

MarchSteps::MarchSteps(const Interval& way, double step) : begin_(way.begin) {
  const double length = way.end - way.begin;
  // Steps that float64 tells apart.
  const double apart = std::max(std::fabs(way.begin), std::fabs(way.end)) * 0x1p-48;
  const double most = std::min(kMostSteps, length / apart);
  size_ = length / std::max(std::min(std::ceil(length / step), most), 1.0);
}

double MarchSteps::first_behind(double t) const {
  double sample = std::max(std::ceil((t - begin_) / size_ - 0.5), 0.0);
  while (sample > 0 && t_of(sample - 1) >= t) {
    --sample;
  }
  while (t_of(sample) < t) {
    ++sample;
  }
  return sample;
}

double MarchSteps::sum(const BrickCells& cells, const Interval& in) const {
  double sum = 0;
  const double last = first_behind(in.end);
  for (double sample = first_behind(in.begin); sample < last; ++sample) {
    sum += cells.value(t_of(sample));
  }
  return sum * size_;
}

std::uint64_t key_of(const RayState& ray, std::uint64_t seed) {
  std::uint64_t key = mix(seed);
  const auto add = [&key](float value) { key = mix(key ^ std::bit_cast<std::uint32_t>(value)); };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    add(ray.org[axis]);
    add(ray.dir[axis]);
  }
  add(ray.tnear);
  add(ray.tfar);
  return key;
}

double track(const BrickCells& cells, const storage::Brick& brick, const Interval& in, double loss, double majorant,
             std::uint64_t key) {
  for (const std::int32_t index : brick.origin) {
    key = mix(key ^ static_cast<std::uint32_t>(index));
  }
  const double control = std::max(0.0F, brick.lower);
  double transmittance = exp_of_minus(control * loss * (in.end - in.begin));
  const double most = (std::max(0.0F, brick.upper) - control) * loss * majorant;
  double t = in.begin;
  // Below float32's least number the answer is 0.
  for (std::uint64_t place = 0; transmittance > 0x1p-160; ++place) {
    t += minus_log(1 - uniform(key, place)) / most;
    if (!(t < in.end)) {
      break;
    }
    transmittance *= 1 - (cells.value(t) - control) * loss / most;
  }
  return transmittance;
}

}  // namespace raymill::traversal
