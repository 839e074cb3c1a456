#include "storage/import/polygon.h"

#include <cmath>
#include <utility>

#include "storage/import/message.h"
#include "storage/import/transform.h"

namespace raymill::storage {

namespace {

// Twice the area vector of a closed polygon (Newell): the sum of the cross products of neighbouring corners, taken from
// the first corner so that far away from the origin nothing is lost.
Vec3d newell_normal(std::span<const Vec3f> corners) {
  const Vec3f& origin = corners[0];
  const auto edge = [&](std::size_t i) {
    return Vec3d{double(corners[i].x) - origin.x, double(corners[i].y) - origin.y, double(corners[i].z) - origin.z};
  };
  Vec3d sum;
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    const Vec3d a = edge(i);
    const Vec3d b = edge(i + 1);
    sum = {sum.x + (a.y * b.z - a.z * b.y), sum.y + (a.z * b.x - a.x * b.z), sum.z + (a.x * b.y - a.y * b.x)};
  }
  return sum;
}

}  // namespace

Status too_many_corners(std::uint64_t corners) {
  return {ErrorCode::unsupported, message("a face has ", corners, " corners and Raymill takes up to ",
                                          kMostPolygonCorners, "; triangulate it before")};
}

Status PolygonWriter::add(std::span<const Vec3f> corners) {
  if (corners.size() < 3) {
    ++report_.counts[ImportCode::left_out_small_faces];
    return {};
  }
  if (corners.size() == 3) {
    return out_.add({corners[0], corners[1], corners[2]});
  }
  if (corners.size() > kMostPolygonCorners) {
    return too_many_corners(corners.size());
  }
  ++report_.counts[ImportCode::polygons];
  if (!project(corners) || convex()) {
    return fan(corners);
  }
  if (corners.size() > kMostConcaveCorners) {
    return {ErrorCode::unsupported,
            message("a face of ", corners.size(), " corners is not convex and Raymill cuts such faces of up to ",
                    kMostConcaveCorners, "; triangulate it before")};
  }
  return cut_ears(corners);
}

// Drops the axis along which the face is seen largest; mirrored where it would be seen from behind. False: no normal.
bool PolygonWriter::project(std::span<const Vec3f> corners) {
  const Vec3d normal = newell_normal(corners);
  const double x = std::abs(normal.x), y = std::abs(normal.y), z = std::abs(normal.z);
  if (!std::isfinite(x + y + z) || x + y + z == 0) {
    return false;
  }
  const int axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
  int across = (axis + 1) % 3, up = (axis + 2) % 3;
  if ((axis == 0 ? normal.x : axis == 1 ? normal.y : normal.z) < 0) {
    std::swap(across, up);
  }
  const auto count = static_cast<std::uint32_t>(corners.size());
  points_.resize(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    points_[i] = {corners[i][across], corners[i][up], i == 0 ? count - 1 : i - 1, i + 1 == count ? 0 : i + 1, false};
  }
  return true;
}

// Positive where a, b, c turn to the left.
double PolygonWriter::turn(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
  const Point& p = points_[a];
  const Point& q = points_[b];
  const Point& r = points_[c];
  return (q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x);
}

// Every corner turns left, and the outline goes forth and back along x once, so it does not wind twice.
bool PolygonWriter::convex() const {
  unsigned changes = 0;
  int direction = 0, first_direction = 0;
  for (std::uint32_t i = 0; i < points_.size(); ++i) {
    const Point& here = points_[i];
    if (!(turn(here.before, i, here.after) >= 0)) {
      return false;
    }
    const double step = points_[here.after].x - here.x;
    const int now = step > 0 ? 1 : step < 0 ? -1 : direction;
    first_direction = first_direction == 0 ? now : first_direction;
    changes += direction != 0 && now != direction ? 1 : 0;
    direction = now;
  }
  return changes + (direction != first_direction ? 1 : 0) <= 2;
}

Status PolygonWriter::fan(std::span<const Vec3f> corners) {
  for (std::size_t i = 2; i < corners.size(); ++i) {
    RAYMILL_RETURN_IF_ERROR(out_.add({corners[0], corners[i - 1], corners[i]}));
  }
  return {};
}

// A corner at the place of a, b or c (a bridge to a hole) is not in the way.
bool PolygonWriter::inside(std::uint32_t corner, std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
  const Point& p = points_[corner];
  for (const std::uint32_t other : {a, b, c}) {
    if (p.x == points_[other].x && p.y == points_[other].y) {
      return false;
    }
  }
  return turn(a, b, corner) >= 0 && turn(b, c, corner) >= 0 && turn(c, a, corner) >= 0;
}

bool PolygonWriter::is_ear(std::uint32_t corner) const {
  const std::uint32_t before = points_[corner].before, after = points_[corner].after;
  if (!(turn(before, corner, after) > 0)) {
    return false;
  }
  // Whatever lies inside, a corner that turns back does too.
  for (std::uint32_t other = points_[after].after; other != before; other = points_[other].after) {
    if (points_[other].turns_back && inside(other, before, corner, after)) {
      return false;
    }
  }
  return true;
}

Status PolygonWriter::cut_ears(std::span<const Vec3f> corners) {
  const auto look = [&](std::uint32_t corner) {
    points_[corner].turns_back = !(turn(points_[corner].before, corner, points_[corner].after) > 0);
  };
  for (std::uint32_t i = 0; i < points_.size(); ++i) {
    look(i);
  }
  std::uint32_t corner = 0;
  for (std::size_t left = points_.size(); left >= 3; --left) {
    for (std::size_t tried = 0; tried < left && left > 3 && !is_ear(corner); ++tried) {
      corner = points_[corner].after;
    }
    const std::uint32_t before = points_[corner].before, after = points_[corner].after;
    RAYMILL_RETURN_IF_ERROR(out_.add({corners[before], corners[corner], corners[after]}));
    points_[before].after = after;
    points_[after].before = before;
    look(before);
    look(after);
    corner = after;
  }
  return {};
}

}  // namespace raymill::storage
