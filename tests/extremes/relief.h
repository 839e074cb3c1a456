// Relief: corners one millimetre apart, anywhere in the world, rays at it, and what somebody's hits are worth.
//
// The truth is quadruple precision on the very numbers that were given: corners and rays in float64, whose differences
// and products it holds without loss. Thread-confined.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tests/support/random.h"
#include "traversal/query.h"

namespace raymill::extremes {

using Point = std::array<double, 3>;

constexpr double kMillimetre = 1e-3;

/// Corner (i, j) stands 0 to 3 mm high over a square of 120 x 120 cells of a millimetre.
struct Relief {
  static constexpr unsigned kCells = 120;

  Point place{};                  ///< of corner (0, 0) of the square, in the world
  std::vector<double> positions;  ///< in the world; or else
  std::vector<float> local;       ///< relative to `place`
  std::vector<std::uint32_t> indices;

  [[nodiscard]] std::size_t triangles() const { return indices.size() / 3; }
};

/// Its positions are float64.
Relief make_relief(tests::Random& random, const Point& place);
/// Its positions are float32 about `place`.
Relief make_local_relief(tests::Random& random, const Point& place);

/// From `distance` away, at most 60 degrees off the upright, at a point of the relief's middle; dir is as long as the
/// way.
std::vector<Ray64> make_rays(tests::Random& random, const Point& place, double distance, std::size_t count);

/// What is nearest, or none: t below 0.
struct Truth {
  std::size_t triangle = 0;
  __extension__ __float128 t = -1;
};
Truth true_hit(const Relief& relief, const Ray64& ray);

/// What somebody's hits are worth. Lengths in metres.
struct Errors {
  std::size_t rays = 0, wrong_hits = 0, wrong_triangles = 0;
  double most_t = 0, most_place = 0;
  double most_off = 0;  ///< of the point from the plane of the triangle that was said to be hit
  std::vector<double> t;

  double median_t();
};
Errors errors_of(const Relief& relief, std::span<const Ray64> rays, std::span<const Truth> truths,
                 std::span<const Hit> hits);

/// A line of a page: `from` and `who`, then the errors.
std::string line_of(const std::string& from, const std::string& who, Errors errors);

}  // namespace raymill::extremes
