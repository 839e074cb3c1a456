#include "storage/import/triangle_filter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace raymill::storage {

namespace {

// Error-free sum: a + b = sum + error (Knuth 1969; Shewchuk 1997, theorem 7). Exact where nothing overflows.
void two_sum(double a, double b, double& sum, double& error) {
  sum = a + b;
  const double b_virtual = sum - a;
  const double a_virtual = sum - b_virtual;
  error = (a - a_virtual) + (b - b_virtual);
}

// True where the terms add up to exactly zero. Their sum is kept as an expansion that does not overlap (Shewchuk 1997,
// Grow-Expansion), which is zero only where every component is.
bool sums_to_zero(const std::array<double, 6>& terms) {
  std::array<double, 6> expansion{};
  std::size_t length = 0;
  for (const double term : terms) {
    double carry = term;
    for (std::size_t i = 0; i < length; ++i) {
      two_sum(carry, expansion[i], carry, expansion[i]);
    }
    expansion[length++] = carry;
  }
  for (const double component : expansion) {
    if (component != 0) {
      return false;
    }
  }
  return true;
}

// True where the projection (ax, ay), (bx, by), (cx, cy) has no area: ax(by-cy) + bx(cy-ay) + cx(ay-by) = 0.
// Written out as six products: of two float32 each, so exact in float64 (48 bits of 53; |exponent| <= 298 of 1022).
bool no_area(float ax, float ay, float bx, float by, float cx, float cy) {
  const std::array<double, 6> terms = {double(ax) * by,  -double(ax) * cy, double(bx) * cy,
                                       -double(bx) * ay, double(cx) * ay,  -double(cx) * by};
  double sum = 0;
  double magnitude = 0;
  for (const double term : terms) {
    sum += term;
    magnitude += std::abs(term);
  }
  // Five roundings of at most 2^-53 of `magnitude` each, which is itself rounded: 1e-15 > 5.1 * 2^-53.
  constexpr double kCertain = 1e-15;
  if (std::abs(sum) > kCertain * magnitude) {
    return false;
  }
  return sums_to_zero(terms);
}

}  // namespace

TriangleVerdict judge(const std::array<Vec3f, 3>& corners) {
  bool in_range = true;
  for (const Vec3f& p : corners) {
    for (const float coordinate : {p.x, p.y, p.z}) {
      if (!std::isfinite(coordinate)) {
        return TriangleVerdict::not_finite;
      }
      in_range = in_range && std::abs(coordinate) <= kPositionLimit;
    }
  }
  if (!in_range) {
    return TriangleVerdict::out_of_range;
  }
  // The cross product of two edges has the projections' areas for its components; equal corners are a case of it.
  const auto& [a, b, c] = corners;
  const bool flat = no_area(a.x, a.y, b.x, b.y, c.x, c.y) && no_area(a.y, a.z, b.y, b.z, c.y, c.z) &&
                    no_area(a.z, a.x, b.z, b.x, c.z, c.x);
  return flat ? TriangleVerdict::degenerate : TriangleVerdict::keep;
}

TriangleWriter::TriangleWriter(TriangleSink& sink, ImportReport& report) : sink_(sink), report_(report) {
  piece_.reserve(kPieceTriangles);
}

Status TriangleWriter::add(const std::array<Vec3f, 3>& corners) {
  GeometryInfo& geometry = report_.geometries[entry_];
  if (primitive_id_ == std::numeric_limits<std::uint32_t>::max()) {
    return {ErrorCode::unsupported, "has a geometry of 2^32 triangles, more than ids reach; split it"};
  }
  const auto primitive_id = static_cast<std::uint32_t>(primitive_id_++);
  ++geometry.triangles;
  ++report_.triangles;
  switch (judge(corners)) {
    case TriangleVerdict::not_finite:
      ++report_.counts[ImportCode::dropped_not_finite];
      return {};
    case TriangleVerdict::out_of_range:
      ++report_.counts[ImportCode::dropped_out_of_range];
      return {};
    case TriangleVerdict::degenerate:
      ++report_.counts[ImportCode::dropped_degenerate];
      return {};
    case TriangleVerdict::keep:
      break;
  }
  if (faces_.all_cut || faces_.first != GeometryMask::kNoFaces) {
    RAYMILL_ASSIGN_OR_RETURN(const bool cut, is_cut(primitive_id));
    if (cut) {
      ++report_.counts[ImportCode::dropped_cut_out];
      return {};
    }
  }
  ++geometry.kept;
  ++report_.kept;
  piece_.push_back({corners, geometry_id_, primitive_id});
  return piece_.size() == kPieceTriangles ? hand_on() : Status();
}

Result<bool> TriangleWriter::is_cut(std::uint32_t primitive_id) {
  if (faces_.all_cut) {
    return true;
  }
  const std::uint64_t face = faces_.first + primitive_id;
  if (face < first_read_ || face >= first_read_ + read_faces_.size()) {
    // Those past the geometry's own may be of another or not there.
    first_read_ = face;
    read_faces_.resize(std::min<std::uint64_t>(kFacePiece, faces_.first + faces_.count - face));
    RAYMILL_RETURN_IF_ERROR(faces_.sink->read_faces(first_read_, read_faces_));
  }
  const std::uint32_t mask = read_faces_[face - first_read_].mask;
  if (mask < FaceMask::kCut) {
    ++report_.counts[ImportCode::masked_triangles];
  } else if (mask == FaceMask::kOpaque) {
    ++report_.counts[ImportCode::opaque_under_masks];
  }
  return mask == FaceMask::kCut;
}

Status TriangleWriter::hand_on() {
  Status status = sink_.add(piece_);
  sink_failed_ = !status.ok();
  piece_.clear();
  return status;
}

}  // namespace raymill::storage
