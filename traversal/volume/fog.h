// What a ray loses in fog: the integral of density along it, or an estimate of the transmittance. Stateless.
#pragma once

#include <cstdint>

#include "storage/volume/volume_page.h"
#include "traversal/query.h"
#include "traversal/ray_state.h"
#include "traversal/volume/brick_cells.h"
#include "traversal/volume/volume_ray.h"

namespace raymill::traversal {

/// The integral of the field over t, exact but for rounding: along a ray it is a cubic in each cell, which two points
/// of Gauss-Legendre integrate.
double integrate(const BrickCells& cells, const Interval& in);

/// Samples of a ray in a volume: at the middle of equal steps over all of the ray's way through the volume's box. Which
/// bricks they fall in does not move them. Immutable.
class MarchSteps {
 public:
  static constexpr double kMostSteps = 0x1p31;

  MarchSteps() = default;
  /// `step`: the longest, in t.
  MarchSteps(const Interval& way, double step);

  [[nodiscard]] double size() const { return size_; }
  /// The first sample at or behind t.
  [[nodiscard]] double first_behind(double t) const;
  [[nodiscard]] double t_of(double sample) const { return begin_ + (sample + 0.5) * size_; }
  /// Of samples from `in`, both a part of the way.
  [[nodiscard]] double sum(const BrickCells& cells, const Interval& in) const;

 private:
  double begin_ = 0;
  double size_ = 0;
};

/// What the random numbers of a ray depend on: the ray and the seed, not its place among others.
std::uint64_t key_of(const RayState& ray, std::uint64_t seed);

/// Residual ratio tracking (Novak, Selle, Jarosz 2014) in one brick: the brick's least density is a control that is
/// integrated exactly, its largest one the majorant. An unbiased estimate of the brick's transmittance.
/// `loss`: of a density of 1 over a t of 1; `majorant`: how many times the least majorant is taken.
double track(const BrickCells& cells, const storage::Brick& brick, const Interval& in, double loss, double majorant,
             std::uint64_t key);

}  // namespace raymill::traversal
