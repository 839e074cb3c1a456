#include "traversal/mask_test.h"

#include <cmath>

#include "storage/base/mask.h"
#include "storage/pages/mask_page.h"

namespace raymill::traversal {
namespace {

using storage::CellState;
using storage::MaskedTriangle;
using storage::MaskInfo;

struct Barycentrics {
  double u, v;
};

// Woop, Benthin, Wald 2013, eq. 1-4, as in kernels/triangle-inl.h.
Barycentrics barycentrics(const MaskHit& hit) {
  std::array<double, 3> size{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    size[axis] = std::fabs(double(hit.dir[axis]));
  }
  const std::size_t kz = size[0] > size[1] ? (size[0] > size[2] ? 0 : 2) : (size[1] > size[2] ? 1 : 2);
  const std::size_t kx = (kz + 1) % 3, ky = (kz + 2) % 3;
  const double sx = double(hit.dir[kx]) / hit.dir[kz], sy = double(hit.dir[ky]) / hit.dir[kz];
  std::array<double, 3> x{}, y{};
  for (std::size_t k = 0; k < 3; ++k) {
    const double z = double(hit.corners[k][kz]) - hit.org[kz];
    x[k] = double(hit.corners[k][kx]) - hit.org[kx] - sx * z;
    y[k] = double(hit.corners[k][ky]) - hit.org[ky] - sy * z;
  }
  const double u = x[2] * y[1] - y[2] * x[1], v = x[0] * y[2] - y[0] * x[2], w = x[1] * y[0] - y[1] * x[0];
  const double sum = u + v + w;
  return sum != 0 && std::isfinite(sum) ? Barycentrics{v / sum, w / sum} : Barycentrics{hit.u, hit.v};
}

// Whether the ray comes from the side where the corners go counterclockwise. Edge-on, where the float64 sum is zero, it
// comes from neither.
bool from_front(const MaskHit& hit, bool clockwise) {
  std::array<double, 3> e1{}, e2{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    e1[axis] = double(hit.corners[1][axis]) - hit.corners[0][axis];
    e2[axis] = double(hit.corners[2][axis]) - hit.corners[0][axis];
  }
  const double along = hit.dir[0] * (e1[1] * e2[2] - e1[2] * e2[1]) + hit.dir[1] * (e1[2] * e2[0] - e1[0] * e2[2]) +
                       hit.dir[2] * (e1[0] * e2[1] - e1[1] * e2[0]);
  return clockwise ? along > 0 : along < 0;
}

}  // namespace

MaskAnswer test_mask(const std::byte* image, std::uint32_t triangle, const MaskHit& hit, std::uint32_t page_bytes) {
  using What = MaskAnswer::What;
  const storage::MaskSectionView masks(image);
  const std::uint16_t index = masks.indices()[triangle];
  if (index == storage::kNoMaskIndex) {
    return {};
  }
  const MaskedTriangle& entry = masks.entries()[index];
  if ((entry.mask & MaskedTriangle::kFrontOnly) != 0 &&
      !from_front(hit, (entry.mask & MaskedTriangle::kFrontClockwise) != 0)) {
    return {.what = What::cut};
  }
  const unsigned number = entry.mask & MaskedTriangle::kMaskBits;
  if (number == MaskedTriangle::kNoMask) {
    return {};
  }
  const storage::MaskRef& mask = masks.masks()[number];
  const MaskInfo& info = mask.info;
  const Barycentrics at = barycentrics(hit);
  const storage::TexelPoint point = storage::texel_point(entry.corners, at.u, at.v, info.width, info.height);
  constexpr double kFar = 0x1p52;
  if (!(std::fabs(point.x) < kFar && std::fabs(point.y) < kFar)) {
    return {};
  }
  const auto x = static_cast<std::int64_t>(std::floor(point.x)), y = static_cast<std::int64_t>(std::floor(point.y));
  switch (cell_state(entry.known, storage::texel_rectangle(entry.corners, info.width, info.height), x, y)) {
    case CellState::opaque:
      return {};
    case CellState::cut:
      return {.what = What::cut};
    default:
      break;
  }
  std::uint32_t least = 1;
  if (info.bits != 1) {
    const std::uint32_t most = info.bits == 8 ? 255 : 65535;
    double alpha = 1;
    if (entry.alpha != storage::kNoMaskIndex) {
      const storage::CornerAlphas& corners = masks.alphas()[entry.alpha];
      alpha = storage::between(corners[0], corners[1], corners[2], at.u, at.v);
    }
    least = storage::least_counting(most, info.factor, alpha, info.cutoff);
    if (least == 0 || least > most) {
      return {.what = least == 0 ? What::counts : What::cut};
    }
  }
  const storage::TexelPlace place = storage::texel_place(info, storage::wrap_texel(x, info.width, info.wrap_s),
                                                         storage::wrap_texel(y, info.height, info.wrap_t), page_bytes);
  return {What::look_up, mask.first_page + place.page, place.texel, static_cast<std::uint16_t>(least), info.bits};
}

bool read_texel(const std::byte* image, std::uint32_t texel, std::uint8_t bits, std::uint16_t least, bool& counts) {
  const storage::MaskPageView page(image);
  if (!page.has(texel, bits)) {
    return false;
  }
  counts = page.value(texel) >= least;
  return true;
}

}  // namespace raymill::traversal
