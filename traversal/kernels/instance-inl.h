// Rays in the space of a placed object, compiled once per ISA.
//
// The ray is taken into the object's space in float64, with what float32 leaves of its org where it brings that, and
// rounded to float32 once; dir keeps its length under the
// inverse, so t counts alike in both spaces. Where it waits inside an object its record holds both rays: the object's,
// so that going on needs no page but the object's, and the world's for the way back. So suspending changes no bit.
//
// Order stays without effect (DESIGN: no t lies before the entry of a box that holds it): a ray enters an instance if
// it meets the instance's own box, which is the same whatever the tree above it, and a hit inside counts with max(t,
// entry of that box). All boxes above hold that box; inside, boxes and t obey slab.h with the object's ray, and a
// larger t never wins against one that was cut.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "storage/pages/page_image.h"
#include "traversal/kernels/exact-inl.h"
#include "traversal/kernels/triangle-inl.h"
#include "traversal/ray_state.h"

namespace raymill::traversal::RAYMILL_ISA {

/// The instance's own box by the formula of the nodes.
template <Mode kMode>
bool meets_box(const RayFrame& frame, const storage::Instance& instance, float tnear, float tfar, float& entry) {
  const auto corner = [](const storage::Vec3f& p) { return std::array<float, 3>{p.x, p.y, p.z}; };
  Interval box = box_interval(frame, corner(instance.lower), corner(instance.upper));
  entry = box.entry;
  if constexpr (kMode == Mode::exact) {
    box.exit = box.exit + kExactSlack;
    entry = 2 * entry;  // boxes count in halves there
  }
  return box.entry <= box.exit && begin_of<kMode>(tnear) <= box.exit && box.entry <= end_of<kMode>(tfar);
}

/// Products of the matrix' columns: normals go by them, and over the determinant they are the rows of the inverse.
inline std::array<std::array<double, 3>, 3> cofactors(const storage::Placement& m) {
  std::array<std::array<double, 3>, 3> rows{};
  for (std::size_t row = 0; row < 3; ++row) {
    const std::size_t a = (row + 1) % 3 * 3, b = (row + 2) % 3 * 3;
    rows[row] = {m[a + 1] * m[b + 2] - m[a + 2] * m[b + 1], m[a + 2] * m[b] - m[a] * m[b + 2],
                 m[a] * m[b + 1] - m[a + 1] * m[b]};
  }
  return rows;
}

/// The ray in the object's space. False: float32 cannot hold it.
inline bool to_object(const storage::Placement& m, RayState& ray) {
  const auto rows = cofactors(m);
  const double det = storage::determinant(m);
  std::array<float, 3> org{}, dir{};
  bool finite = true, turned = false;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    double o = 0, d = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      o += rows[axis][k] * (double(ray.org[k]) + double(ray.org_rest[k]) - m[9 + k]);
      d += rows[axis][k] * double(ray.dir[k]);
    }
    org[axis] = static_cast<float>(o / det);
    dir[axis] = static_cast<float>(d / det);
    finite = finite && std::isfinite(org[axis]) && std::isfinite(dir[axis]);
    turned = turned || dir[axis] != 0;
  }
  if (!finite || !turned) {
    return false;
  }
  ray.object.world_org = ray.org;
  ray.object.world_dir = ray.dir;
  ray.org = org;
  ray.dir = dir;
  return true;
}

/// What takes normals of the object to the world, up to their length.
inline std::array<std::array<float, 3>, 3> normal_columns(const storage::Placement& m) {
  const auto rows = cofactors(m);
  double most = 0;
  for (const auto& row : rows) {
    for (const double x : row) {
      most = std::max(most, std::fabs(x));
    }
  }
  std::array<std::array<float, 3>, 3> columns{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      columns[i][k] = static_cast<float>(rows[i][k] / most);
    }
  }
  return columns;
}

inline std::array<float, 3> world_normal(const std::array<std::array<float, 3>, 3>& columns,
                                         const std::array<float, 3>& normal) {
  std::array<double, 3> n{};
  for (std::size_t k = 0; k < 3; ++k) {
    for (std::size_t i = 0; i < 3; ++i) {
      n[k] += double(columns[i][k]) * normal[i];
    }
  }
  const double length = std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
  std::array<float, 3> out{};
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = length > 0 ? static_cast<float>(n[k] / length) : 0.0F;
  }
  return out;
}

}  // namespace raymill::traversal::RAYMILL_ISA
