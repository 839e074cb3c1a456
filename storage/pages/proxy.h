// Proxy: what stands for a subtree that a ray does not enter: surface area, normal and coverage of its triangles.
//
// A store that was built with proxies has one beside each external reference, and those of kind `proxied` count: they
// lead from a node to a child whose node stands in another page. Whether a reference is one depends on the edge of the
// tree alone, not on the page that it is met in: a ghost's reference is proxied exactly where its node's own is.
// Normative description: storage/FORMAT.md, "Proxies". Plain values; immutable. What kernels call is inlined always:
// they are compiled for several machines, and no machine may get another's copy.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <type_traits>

#include "storage/base/vec3.h"

namespace raymill::storage {

/// Of a subtree's triangles in its box; all shares are of `faces`, the sum of the three areas of the box' faces.
struct Proxy {
  /// Square roots of the diagonal of S, as shares of faces: upper halves of float32. S = A sum(a n n^T), a area and n
  /// unit normal of each triangle, A the sum of areas, so that sqrt(d^T S d) is the area that a flat piece shows to d,
  /// and at least the area that any shows (Cauchy-Schwarz); Heitz, Dupuy, Crassin, Dachsbacher 2015 ("SGGX") keep a
  /// distribution of normals so.
  std::array<std::uint16_t, 3> area{};
  std::array<std::int8_t, 3> mixed{};   ///< S_yz, S_zx, S_xy over the product of their axes' roots, times 127
  std::array<std::int8_t, 3> normal{};  ///< mean, or of the largest triangle where that is all but zero; times 127
  std::array<std::uint8_t, 3>
      coverage{};                 ///< along each axis, the part of the box' face that triangles lie over, / 255
  std::uint8_t several = 0;       ///< 1: of more than one geometry
  std::uint32_t geometry_id = 0;  ///< of the largest triangle
  std::uint32_t primitive_id = 0;
};
static_assert(sizeof(Proxy) == 24 && std::is_trivially_copyable_v<Proxy>);

/// The areas of a box' faces, across x, y and z.
[[gnu::always_inline]] inline std::array<double, 3> face_areas(const std::array<float, 3>& lower,
                                                               const std::array<float, 3>& upper) {
  std::array<double, 3> size{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    size[axis] = double(upper[axis]) - lower[axis];
  }
  return {size[1] * size[2], size[2] * size[0], size[0] * size[1]};
}

/// A float32 without the lower half of its digits, rounded to nearest; finite.
inline std::uint16_t to_half_digits(double value) {
  constexpr std::uint32_t kLargest = 0x7F7FU;
  const std::uint32_t bits = std::bit_cast<std::uint32_t>(static_cast<float>(value));
  const std::uint32_t rounded = (bits + 0x8000U) >> 16;
  return static_cast<std::uint16_t>(rounded < kLargest ? rounded : kLargest);
}
[[gnu::always_inline]] inline float from_half_digits(std::uint16_t bits) {
  return std::bit_cast<float>(std::uint32_t(bits) << 16);
}

/// The part of the rays along `dir` through the box that are taken to hit: what the box' faces show of their coverage,
/// at most the area that its triangles show. 0 to 1; 0 for a ray in the plane of a flat box.
[[gnu::always_inline]] inline double opacity(const Proxy& proxy, const std::array<double, 3>& faces,
                                             const std::array<float, 3>& dir) {
  double shown = 0, covered = 0, squares = 0;
  const double all = faces[0] + faces[1] + faces[2];
  std::array<double, 3> along{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double part = std::fabs(double(dir[axis])) * faces[axis];
    shown += part;
    covered += part * (proxy.coverage[axis] / 255.0);
    along[axis] = double(dir[axis]) * from_half_digits(proxy.area[axis]);
    squares += along[axis] * along[axis];
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    squares += 2 * along[(axis + 1) % 3] * along[(axis + 2) % 3] * (proxy.mixed[axis] / 127.0);
  }
  const double area = squares > 0 ? std::sqrt(squares) * all : 0;
  const double hit = covered < area ? covered : area;
  return !(shown > 0) ? 0 : hit < shown ? hit / shown : 1;
}

}  // namespace raymill::storage
