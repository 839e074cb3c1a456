// VolumeRay: a ray in a volume's index space, and where it crosses the planes between cells.
//
// Everything is decided by the t of planes at integer indices, computed by one formula. So the children of a node meet
// without a gap or an overlap along the ray, whoever asks for them and from whichever page. Immutable values.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>

#include "storage/volume/affine.h"
#include "storage/volume/volume_page.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

struct Interval {
  double begin = 0, end = 0;
  [[nodiscard]] bool empty() const { return !(begin < end); }
};

class VolumeRay {
 public:
  VolumeRay() = default;
  VolumeRay(const storage::Volume& volume, const RayState& ray) {
    storage::Point3 o{}, d{};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      o[axis] = ray.org[axis];
      d[axis] = ray.dir[axis];
    }
    org_ = storage::map_point(volume.index_from_world, o);
    dir_ = storage::map_direction(volume.index_from_world, d);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      inverse_[axis] = 1 / dir_[axis];
    }
  }

  [[nodiscard]] double at(std::size_t axis, double t) const { return org_[axis] + dir_[axis] * t; }
  [[nodiscard]] double dir(std::size_t axis) const { return dir_[axis]; }
  [[nodiscard]] bool forward(std::size_t axis) const { return dir_[axis] > 0; }
  [[nodiscard]] bool parallel(std::size_t axis) const { return dir_[axis] == 0; }
  /// Of the plane at `index`; not for an axis that the ray is parallel to.
  [[nodiscard]] double plane(std::size_t axis, std::int32_t index) const {
    return (double(index) - org_[axis]) * inverse_[axis];
  }

  /// Where the ray is in a box of so many cells; empty where it is not.
  [[nodiscard]] Interval in_box(const storage::Index3& origin, const storage::Index3& cells) const {
    Interval in{-std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::int32_t end = origin[axis] + cells[axis];
      if (parallel(axis)) {
        if (!(org_[axis] >= origin[axis] && org_[axis] < end)) {
          return {0, 0};
        }
        continue;
      }
      const double first = plane(axis, forward(axis) ? origin[axis] : end);
      const double last = plane(axis, forward(axis) ? end : origin[axis]);
      in.begin = std::max(in.begin, first);
      in.end = std::min(in.end, last);
    }
    return in;
  }

  /// Which of `count` parts of `size` cells, the first at `origin`, the ray is in at t along an axis. A part begins at
  /// its plane and ends before the next one's.
  [[nodiscard]] std::int32_t part(std::size_t axis, std::int32_t origin, std::int32_t size, std::int32_t count,
                                  double t) const {
    std::int32_t passed = 0;
    for (std::int32_t i = 1; i < count; ++i) {
      const std::int32_t index = origin + size * (dir_[axis] < 0 ? count - i : i);
      passed += (parallel(axis) ? index <= org_[axis] : plane(axis, index) <= t) ? 1 : 0;
    }
    return dir_[axis] < 0 ? count - 1 - passed : passed;
  }

 private:
  storage::Point3 org_{}, dir_{}, inverse_{};
};

}  // namespace raymill::traversal
