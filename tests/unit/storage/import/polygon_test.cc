#include "storage/import/polygon.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace raymill::storage {
namespace {

using Outline = std::vector<Vec3f>;

class Kept final : public TriangleSink {
 public:
  Status add(std::span<const Triangle> more) override {
    triangles.insert(triangles.end(), more.begin(), more.end());
    return {};
  }
  std::vector<Triangle> triangles;
};

struct Cut {
  Status status;
  std::vector<Triangle> triangles;
  std::uint64_t numbered = 0;  // dropped ones too
};

Cut cut(const Outline& corners) {
  Kept kept;
  ImportReport report;
  report.geometries.emplace_back();
  TriangleWriter out(kept, report);
  out.begin_geometry();
  Cut result;
  result.status = PolygonWriter(out, report).add(corners);
  EXPECT_TRUE(out.flush().ok());
  result.triangles = std::move(kept.triangles);
  result.numbered = report.geometries[0].triangles;
  return result;
}

double area_z(const Triangle& t) {
  return 0.5 * ((double(t.v[1].x) - t.v[0].x) * (double(t.v[2].y) - t.v[0].y) -
                (double(t.v[1].y) - t.v[0].y) * (double(t.v[2].x) - t.v[0].x));
}

double area_z(const Outline& corners) {
  double sum = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vec3f& a = corners[i];
    const Vec3f& b = corners[(i + 1) % corners.size()];
    sum += 0.5 * (double(a.x) * b.y - double(a.y) * b.x);
  }
  return sum;
}

// Triangles that all turn the face's way and have its area cover it once.
void expect_covered(const Outline& corners) {
  const Cut result = cut(corners);
  ASSERT_TRUE(result.status.ok()) << result.status.message();
  EXPECT_EQ(result.numbered, corners.size() - 2);
  const double whole = area_z(corners);
  double sum = 0;
  for (const Triangle& triangle : result.triangles) {
    EXPECT_GT(area_z(triangle) * whole, 0);
    sum += area_z(triangle);
  }
  EXPECT_NEAR(sum, whole, 1e-6 * std::abs(whole));
}

TEST(Polygon, ConvexFacesAreFans) {
  const Cut result = cut({{0, 0, 0}, {2, 0, 0}, {3, 1, 0}, {2, 2, 0}, {0, 2, 0}});
  ASSERT_EQ(result.triangles.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(result.triangles[i].v[0], (Vec3f{0, 0, 0}));
    EXPECT_EQ(result.triangles[i].primitive_id, i);
  }
  EXPECT_EQ(result.triangles[1].v[1], (Vec3f{3, 1, 0}));
  EXPECT_EQ(result.triangles[1].v[2], (Vec3f{2, 2, 0}));
}

TEST(Polygon, QuadsThatAreNotConvexAreCutAtTheirDent) {
  // The dent is corner 1, so a fan around corner 0 would leave the face.
  expect_covered({{0, 0, 0}, {1, 0.1F, 0}, {2, 0, 0}, {1, 2, 0}});
  expect_covered({{1, 0.5F, 0}, {2, 0, 0}, {1, 2, 0}, {0, 0, 0}});
  expect_covered({{2, 0, 0}, {1, 0.5F, 0}, {0, 0, 0}, {1, 2, 0}});
}

TEST(Polygon, CombsAndStarsAreCovered) {
  expect_covered({{0, 0, 0}, {5, 0, 0}, {5, 3, 0}, {4, 1, 0}, {3, 3, 0}, {2, 1, 0}, {1, 3, 0}});
  std::mt19937 random(7);
  for (int count = 5; count < 200; count += 7) {
    Outline star;
    for (int i = 0; i < count; ++i) {
      const double angle = 2 * std::numbers::pi * i / count;
      const double radius = 1 + static_cast<double>(random() % 1000) / 100;
      star.push_back({static_cast<float>(radius * std::cos(angle)), static_cast<float>(radius * std::sin(angle)), 5});
    }
    expect_covered(star);
    std::reverse(star.begin(), star.end());
    expect_covered(star);
  }
}

TEST(Polygon, AHoleThroughABridgeIsLeftOpen) {
  expect_covered({{0, 0, 0},
                  {4, 0, 0},
                  {4, 4, 0},
                  {0, 4, 0},
                  {0, 0, 0},  // around
                  {1, 1, 0},
                  {1, 3, 0},
                  {3, 3, 0},
                  {3, 1, 0},
                  {1, 1, 0}});
}

TEST(Polygon, EveryAxisAndDirection) {
  const Outline flat = {{0, 0, 0}, {1, 0.1F, 0}, {2, 0, 0}, {1, 2, 0}};
  for (int turn = 0; turn < 6; ++turn) {
    Outline corners;
    for (const Vec3f& p : flat) {
      const Vec3f q = turn % 3 == 0 ? p : turn % 3 == 1 ? Vec3f{p.z, p.x, p.y} : Vec3f{p.y, p.z, p.x};
      corners.push_back(q);
    }
    if (turn >= 3) {
      std::reverse(corners.begin(), corners.end());
    }
    const Cut result = cut(corners);
    ASSERT_EQ(result.triangles.size(), 2U) << turn;
    // The dent belongs to both.
    const Vec3f dent = corners[turn >= 3 ? 2 : 1];
    for (const Triangle& triangle : result.triangles) {
      EXPECT_NE(std::find(triangle.v.begin(), triangle.v.end(), dent), triangle.v.end()) << turn;
    }
  }
}

TEST(Polygon, FacesThatCrossThemselvesOrAreFlatKeepTheirNumber) {
  Outline pentagram;
  for (int i = 0; i < 5; ++i) {
    const double angle = 2 * std::numbers::pi * 2 * i / 5;
    pentagram.push_back({static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0});
  }
  EXPECT_EQ(cut(pentagram).numbered, 3U);
  EXPECT_EQ(cut({{0, 0, 0}, {1, 1, 0}, {1, 0, 0}, {0, 1, 0}}).numbered, 2U);
  EXPECT_EQ(cut({{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {3, 3, 3}}).numbered, 2U);
  EXPECT_EQ(cut(Outline(9)).numbered, 7U);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Cut result = cut({{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {nan, 1, 0}});
  EXPECT_EQ(result.numbered, 2U);
  EXPECT_EQ(result.triangles.size(), 1U);
  EXPECT_EQ(cut({{0, 0, 0}, {3e38F, 0, 0}, {3e38F, 3e38F, 0}, {-3e38F, 3e38F, 3e38F}}).numbered, 2U);
}

TEST(Polygon, LargeFaces) {
  const auto ring = [](int count, float dent) {
    Outline corners;
    for (int i = 0; i < count; ++i) {
      const double angle = 2 * std::numbers::pi * i / count;
      const double radius = i % 2 == 0 ? 100 : 100 - dent;
      corners.push_back(
          {static_cast<float>(radius * std::cos(angle)), static_cast<float>(radius * std::sin(angle)), 0});
    }
    return corners;
  };
  EXPECT_EQ(cut(ring(4000, 0)).status.ok(), true);
  expect_covered(ring(1024, 1));
  const Cut refused = cut(ring(1026, 1));
  EXPECT_EQ(refused.status.code(), ErrorCode::unsupported);
  EXPECT_EQ(refused.status.message(),
            "a face of 1026 corners is not convex and Raymill cuts such faces of up to 1024; triangulate it before");
}

}  // namespace
}  // namespace raymill::storage
