// Polygon: a face of any number of corners becomes triangles, the same ones every time.
//
// A face of n corners gives n - 2 triangles whatever its shape, so primitive ids do not depend on coordinates; all keep
// the face's direction. Projected along the largest component of Newell's normal (the first of equal ones), a convex
// face is a fan around its first corner: (0 1 2), (0 2 3), ... Any other loses one ear after the other (Meisters 1975):
// from corner 0 on, a corner that turns the face's way and whose triangle holds no other corner is cut off, and the
// search goes on behind it. Where a round finds no ear (the face crosses itself, or is flat), the next corner is cut
// off unseen. A face with a corner that is not finite, or without a normal, is a fan. Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/import/triangle_filter.h"

namespace raymill::storage {

/// Of one face. Scratch grows with it.
constexpr std::size_t kMostPolygonCorners = 16384;
/// Of a face that is not convex: ears take up to the cube of it.
constexpr std::size_t kMostConcaveCorners = 1024;

/// The refusal of a face of more corners than kMostPolygonCorners.
Status too_many_corners(std::uint64_t corners);

class PolygonWriter {
 public:
  PolygonWriter(TriangleWriter& out, ImportReport& report) : out_(out), report_(report) {}

  /// Hands on the triangles of a face; one of fewer than three corners is counted and left out.
  /// Errors: unsupported (more corners than a limit above), and the sink's.
  Status add(std::span<const Vec3f> corners);

  /// What the writer holds at most, for the claim.
  static constexpr std::uint64_t heap_bytes() { return kMostPolygonCorners * sizeof(Point) * 2; }

 private:
  struct Point {
    double x = 0, y = 0;
    std::uint32_t before = 0, after = 0;  // neighbours among those that are left
    bool turns_back = false;
  };

  bool project(std::span<const Vec3f> corners);
  [[nodiscard]] bool convex() const;
  Status fan(std::span<const Vec3f> corners);
  Status cut_ears(std::span<const Vec3f> corners);
  [[nodiscard]] double turn(std::uint32_t a, std::uint32_t b, std::uint32_t c) const;
  [[nodiscard]] bool is_ear(std::uint32_t corner) const;
  [[nodiscard]] bool inside(std::uint32_t corner, std::uint32_t a, std::uint32_t b, std::uint32_t c) const;

  TriangleWriter& out_;
  ImportReport& report_;
  std::vector<Point> points_;
};

}  // namespace raymill::storage
