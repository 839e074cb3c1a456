#include "traversal/volume/level_set.h"

#include <algorithm>
#include <cmath>

namespace raymill::traversal {
namespace {

double evaluate(const std::array<double, 4>& cubic, double s) {
  return ((cubic[3] * s + cubic[2]) * s + cubic[1]) * s + cubic[0];
}

// Where the cubic turns: roots of its derivative in (0, 1), rising; 1 where there are fewer.
std::array<double, 2> turns_of(const std::array<double, 4>& cubic) {
  const double a = 3 * cubic[3], b = 2 * cubic[2], c = cubic[1];
  std::array<double, 2> turns{1, 1};
  const double discriminant = b * b - 4 * a * c;
  if (discriminant >= 0) {
    const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
    turns = {q / a, c / q};  // either may be no number
  }
  for (double& turn : turns) {
    turn = turn > 0 && turn < 1 ? turn : 1;
  }
  std::sort(turns.begin(), turns.end());
  return turns;
}

// The change of side between two places, by halving: 52 times leave no number between them.
double narrow(const std::array<double, 4>& cubic, double low, double high) {
  const double side = side_of(evaluate(cubic, low));
  for (int i = 0; i < 52; ++i) {
    const double middle = 0.5 * (low + high);
    (side_of(evaluate(cubic, middle)) == side ? low : high) = middle;
  }
  return high;
}

// Calls visit(s) at each change of side, rising, until it returns false: there is one at most between two turns.
template <typename Visit>
void each_change(const std::array<double, 4>& cubic, Visit&& visit) {
  double low = 0;
  const auto turns = turns_of(cubic);
  for (const double high : {turns[0], turns[1], 1.0}) {
    if (high > low && side_of(evaluate(cubic, low)) != side_of(evaluate(cubic, high)) &&
        !visit(narrow(cubic, low, high))) {
      return;
    }
    low = high;
  }
}

}  // namespace

std::array<double, 4> TrilinearCell::along(const std::array<double, 3>& a, const std::array<double, 3>& b) const {
  return {one_ + x_ * a[0] + y_ * a[1] + z_ * a[2] + xy_ * a[0] * a[1] + xz_ * a[0] * a[2] + yz_ * a[1] * a[2] +
              xyz_ * a[0] * a[1] * a[2],
          x_ * b[0] + y_ * b[1] + z_ * b[2] + xy_ * (a[0] * b[1] + b[0] * a[1]) + xz_ * (a[0] * b[2] + b[0] * a[2]) +
              yz_ * (a[1] * b[2] + b[1] * a[2]) + xyz_ * (b[0] * a[1] * a[2] + a[0] * b[1] * a[2] + a[0] * a[1] * b[2]),
          xy_ * b[0] * b[1] + xz_ * b[0] * b[2] + yz_ * b[1] * b[2] +
              xyz_ * (b[0] * b[1] * a[2] + b[0] * a[1] * b[2] + a[0] * b[1] * b[2]),
          xyz_ * b[0] * b[1] * b[2]};
}

std::optional<double> first_change(const std::array<double, 4>& cubic) {
  std::optional<double> first;
  each_change(cubic, [&first](double s) {
    first = s;
    return false;
  });
  return first;
}

std::array<double, 3> changes_of(const std::array<double, 4>& cubic) {
  std::array<double, 3> changes{2, 2, 2};
  std::size_t count = 0;
  each_change(cubic, [&](double s) {
    changes[count++] = s;
    return true;
  });
  return changes;
}

std::optional<SurfaceCrossing> first_crossing(const BrickCells& cells, const Interval& in, double& side) {
  std::optional<SurfaceCrossing> found;
  cells.each(in, [&](const Cell& cell, double begin, double end) {
    const auto corners = cells.corners(cell);
    const auto [least, most] = std::minmax_element(corners.begin(), corners.end());
    const bool one_side = side_of(*least) == side_of(*most);
    if (one_side && (side == 0 || side == side_of(*least))) {
      side = side_of(*least);
      return true;
    }
    const TrilinearCell field(corners);
    const auto from = cells.place(cell, begin), to = cells.place(cell, end);
    const auto cubic = field.along(from, {to[0] - from[0], to[1] - from[1], to[2] - from[2]});
    const double side_here = one_side ? side_of(*least) : side_of(evaluate(cubic, 0));
    std::optional<double> s = side != 0 && side_here != side ? std::optional(0.0) : std::nullopt;
    if (!s && !one_side) {
      s = first_change(cubic);
    }
    if (s) {
      const double t = begin + *s * (end - begin);
      found = SurfaceCrossing{t, field.gradient(cells.place(cell, t))};
      return false;
    }
    side = side_of(evaluate(cubic, 1));
    return true;
  });
  return found;
}

}  // namespace raymill::traversal
