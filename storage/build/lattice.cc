#include "storage/build/lattice.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace raymill::storage {
namespace {

constexpr unsigned kMinBits = 4;
constexpr unsigned kMaxBits = 30;
constexpr int kMaxExponent = 120;
constexpr double kMostSteps = 2147483647.0;
constexpr int kSquareBits = 28;

Status bad_request(const std::string& text) {
  return {ErrorCode::invalid_argument, "--positions " + text +
                                           " is none of float32, lattice:STEP (scene units, above zero) and "
                                           "lattice:BITSb (4 to 30 bits over the scene's largest extent)"};
}

int step_exponent_of(const PositionsRequest& request, const Aabb& box) {
  if (request.kind == PositionsRequest::Kind::lattice_step) {
    return std::ilogb(request.step);
  }
  double extent = 0;
  for (int axis = 0; axis < 3; ++axis) {
    extent = std::max(extent, double(box.upper[axis]) - box.lower[axis]);
  }
  if (!(extent > 0)) {
    return 0;
  }
  // The least power of two that reaches over the extent in 2^bits steps.
  const int exponent = std::ilogb(extent) - static_cast<int>(request.bits);
  return std::ldexp(1.0, exponent + static_cast<int>(request.bits)) < extent ? exponent + 1 : exponent;
}

bool degenerate(const Triangle& t) { return t.v[0] == t.v[1] || t.v[1] == t.v[2] || t.v[2] == t.v[0]; }

}  // namespace

Result<PositionsRequest> parse_positions(const std::string& text) {
  PositionsRequest request;
  if (text == "float32") {
    return request;
  }
  const std::string prefix = "lattice:";
  if (text.compare(0, prefix.size(), prefix) != 0) {
    return bad_request(text);
  }
  const char* begin = text.data() + prefix.size();
  const char* end = text.data() + text.size();
  if (end - begin > 1 && end[-1] == 'b') {
    request.kind = PositionsRequest::Kind::lattice_bits;
    const auto [last, error] = std::from_chars(begin, end - 1, request.bits);
    if (error != std::errc{} || last != end - 1 || request.bits < kMinBits || request.bits > kMaxBits) {
      return bad_request(text);
    }
    return request;
  }
  request.kind = PositionsRequest::Kind::lattice_step;
  const auto [last, error] = std::from_chars(begin, end, request.step);
  if (error != std::errc{} || last != end || !(request.step > 0) || !std::isfinite(request.step) ||
      std::abs(std::ilogb(request.step)) > kMaxExponent) {
    return bad_request(text);
  }
  return request;
}

Lattice::Lattice(const PositionsRequest& request, const Aabb& box)
    : active_(request.kind != PositionsRequest::Kind::float32),
      step_exponent_(active_ ? step_exponent_of(request, box) : 0),
      step_(std::ldexp(1.0, step_exponent_)) {}

Lattice::Outcome Lattice::snap(Triangle& t) {
  if (!active_) {
    return Outcome::kept;
  }
  for (Vec3f& corner : t.v) {
    double square = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double steps = std::nearbyint(corner[axis] / step_);
      if (std::abs(steps) > kMostSteps) {
        return Outcome::out_of_range;
      }
      // Exact: where float32 is coarser than the step, the coordinate was a multiple already. Zero has no sign.
      const auto snapped = static_cast<float>(steps * step_ + 0.0);
      const double moved = double(snapped) - corner[axis];
      square += moved * moved;
      corner[axis] = snapped;
    }
    max_displacement_ = std::max(max_displacement_, std::sqrt(square));
    // At most 3/4 of a square step each: the sum holds 2^36 corners.
    squares_ += static_cast<std::uint64_t>(std::ldexp(square / step_ / step_, kSquareBits));
    ++corners_;
  }
  return degenerate(t) ? Outcome::degenerate : Outcome::kept;
}

double Lattice::rms_displacement() const {
  return corners_ == 0 ? 0 : step_ * std::sqrt(std::ldexp(double(squares_), -kSquareBits) / double(corners_));
}

Status Lattice::out_of_range(const Triangle& t) const {
  float most = 0;
  for (const Vec3f& corner : t.v) {
    for (int axis = 0; axis < 3; ++axis) {
      most = std::abs(corner[axis]) > std::abs(most) ? corner[axis] : most;
    }
  }
  return {ErrorCode::invalid_argument, "a lattice step of " + std::to_string(step_) + " puts the coordinate " +
                                           std::to_string(most) + " more than 2^31 steps from zero; use a larger step"};
}

Result<LatticeResult> snap_to_lattice(const PositionsRequest& request, std::vector<Triangle>& triangles) {
  Aabb box;
  for (const Triangle& t : triangles) {
    box.grow(bounds(t));
  }
  Lattice lattice(request, box);
  std::size_t kept = 0;
  for (Triangle& t : triangles) {
    const Lattice::Outcome outcome = lattice.snap(t);
    if (outcome == Lattice::Outcome::out_of_range) {
      return lattice.out_of_range(t);
    }
    if (outcome == Lattice::Outcome::kept) {
      triangles[kept++] = t;
    }
  }
  LatticeResult result{lattice.step_exponent(), lattice.max_displacement(), triangles.size() - kept};
  triangles.resize(kept);
  return result;
}

}  // namespace raymill::storage
