#include "storage/import/triangle_filter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "storage/import/scene_import.h"

namespace raymill::storage {
namespace {

using Corners = std::array<Vec3f, 3>;

TEST(TriangleFilter, PlainTrianglesAreKept) {
  EXPECT_EQ(judge(Corners{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}}), TriangleVerdict::keep);
  EXPECT_EQ(judge(Corners{{{0, 0, 0}, {0, 1, 0}, {0, 0, 1}}}), TriangleVerdict::keep);
  EXPECT_EQ(judge(Corners{{{0, 5, 0}, {1, 5, 0}, {0, 5, 1}}}), TriangleVerdict::keep);
}

TEST(TriangleFilter, EqualCornersAreDegenerate) {
  EXPECT_EQ(judge(Corners{{{1, 2, 3}, {1, 2, 3}, {0, 1, 0}}}), TriangleVerdict::degenerate);
  EXPECT_EQ(judge(Corners{{{0, 1, 0}, {1, 2, 3}, {1, 2, 3}}}), TriangleVerdict::degenerate);
  EXPECT_EQ(judge(Corners{{{1, 2, 3}, {0, 1, 0}, {1, 2, 3}}}), TriangleVerdict::degenerate);
  EXPECT_EQ(judge(Corners{{{0.0F, 1, 2}, {-0.0F, 1, 2}, {4, 4, 4}}}), TriangleVerdict::degenerate);
}

TEST(TriangleFilter, CornersInARowAreDegenerate) {
  EXPECT_EQ(judge(Corners{{{1, 1, 1}, {2, 2, 2}, {3, 3, 3}}}), TriangleVerdict::degenerate);
  EXPECT_EQ(judge(Corners{{{0.1F, 0.2F, 0.3F}, {0.2F, 0.4F, 0.6F}, {0, 0, 0}}}), TriangleVerdict::degenerate);
}

TEST(TriangleFilter, OneUnitInTheLastPlaceIsNotDegenerate) {
  const float above = std::nextafter(3.0F, 4.0F);
  EXPECT_EQ(judge(Corners{{{1, 1, 1}, {2, 2, 2}, {3, above, 3}}}), TriangleVerdict::keep);
  const float far_above = std::nextafter(3e6F, 4e6F);
  EXPECT_EQ(judge(Corners{{{1e6F, 1e6F, 0}, {2e6F, 2e6F, 0}, {3e6F, far_above, 0}}}), TriangleVerdict::keep);
}

TEST(TriangleFilter, AreaThatFloat64LosesIsStillSeen) {
  // The double area is 2^-149 * 2^100 beside products of 2^200: nothing of it is left in a float64 sum.
  const float tiny = std::numeric_limits<float>::denorm_min();
  const float huge = 0x1p100F;
  EXPECT_EQ(judge(Corners{{{huge, huge, 0}, {-huge, -huge, 0}, {tiny, 0, 0}}}), TriangleVerdict::keep);
  EXPECT_EQ(judge(Corners{{{huge, huge, 0}, {-huge, -huge, 0}, {tiny, tiny, 0}}}), TriangleVerdict::degenerate);
  EXPECT_EQ(judge(Corners{{{tiny, 0, 0}, {0, tiny, 0}, {0, 0, 0}}}), TriangleVerdict::keep);
}

TEST(TriangleFilter, RandomRowsAgreeWithIntegerArithmetic) {
  std::mt19937 random(7);
  std::uniform_int_distribution<int> coordinate(-(1 << 23), 1 << 23);
  std::uniform_int_distribution<int> step(-3, 3);
  std::uniform_int_distribution<int> exponent(-60, 60);
  int degenerate_count = 0;
  for (int round = 0; round < 100000; ++round) {
    long long a[3], b[3], c[3];
    for (int axis = 0; axis < 3; ++axis) {
      a[axis] = coordinate(random) / 4;
      const int d = coordinate(random) / 8;
      b[axis] = a[axis] + d;
      c[axis] = a[axis] - d + (round % 2 == 0 ? 0 : step(random));
    }
    bool flat = true;
    for (int axis = 0; axis < 3; ++axis) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      flat = flat && (b[u] - a[u]) * (c[v] - a[v]) == (b[v] - a[v]) * (c[u] - a[u]);
    }
    degenerate_count += flat ? 1 : 0;
    const int scale = exponent(random);
    const auto corner = [&](const long long* p) {
      return Vec3f{std::ldexp(static_cast<float>(p[0]), scale), std::ldexp(static_cast<float>(p[1]), scale),
                   std::ldexp(static_cast<float>(p[2]), scale)};
    };
    ASSERT_EQ(judge(Corners{corner(a), corner(b), corner(c)}),
              flat ? TriangleVerdict::degenerate : TriangleVerdict::keep)
        << round;
  }
  EXPECT_GT(degenerate_count, 50000 - 1);
}

TEST(TriangleFilter, LimitIsKeptAndBeyondIsNot) {
  const float beyond = std::nextafter(kPositionLimit, std::numeric_limits<float>::infinity());
  EXPECT_EQ(judge(Corners{{{kPositionLimit, 0, 0}, {-kPositionLimit, 0, 0}, {0, kPositionLimit, 0}}}),
            TriangleVerdict::keep);
  EXPECT_EQ(judge(Corners{{{0, 0, 0}, {1, 0, -beyond}, {0, 1, 0}}}), TriangleVerdict::out_of_range);
}

TEST(TriangleFilter, NotFiniteComesFirst) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  EXPECT_EQ(judge(Corners{{{0, 0, 0}, {0, 0, 0}, {0, nan, 0}}}), TriangleVerdict::not_finite);
  EXPECT_EQ(judge(Corners{{{3e38F, 0, 0}, {0, 0, -infinity}, {0, 1, 0}}}), TriangleVerdict::not_finite);
}

TEST(ImportReport, Json) {
  ImportReport report;
  report.counts[ImportCode::left_out_lines] = 2;
  report.counts[ImportCode::dropped_degenerate] = 3;
  report.ignored_extensions = {"A", "B"};
  report.triangles = 10;
  report.kept = 7;
  EXPECT_EQ(to_json(report),
            R"({"counts":{"dropped_degenerate":{"code":100,"count":3},"left_out_lines":{"code":201,"count":2}},)"
            R"("ignored_extensions":["A","B"],"triangles":10,"kept":7})");
  EXPECT_EQ(to_json({}), R"({"counts":{},"ignored_extensions":[],"triangles":0,"kept":0})");
}

}  // namespace
}  // namespace raymill::storage
