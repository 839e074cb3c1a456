#include "storage/build/lattice.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/scenes.h"

namespace raymill::storage {
namespace {

using Kind = PositionsRequest::Kind;

TEST(Lattice, RequestsAreParsed) {
  EXPECT_EQ(parse_positions("float32")->kind, Kind::float32);
  const auto step = parse_positions("lattice:0.01");
  ASSERT_TRUE(step);
  EXPECT_EQ(step->kind, Kind::lattice_step);
  EXPECT_EQ(step->step, 0.01);
  const auto bits = parse_positions("lattice:16b");
  ASSERT_TRUE(bits);
  EXPECT_EQ(bits->kind, Kind::lattice_bits);
  EXPECT_EQ(bits->bits, 16u);
}

TEST(Lattice, NonsenseIsRefused) {
  for (const char* text : {"", "float64", "lattice", "lattice:", "lattice:0", "lattice:-1", "lattice:nan",
                           "lattice:inf", "lattice:1e300", "lattice:1e-300", "lattice:3b", "lattice:31b", "lattice:b",
                           "lattice:1 ", " lattice:1", "lattice:1x", "lattice:16bb", "lattice:-8b"}) {
    EXPECT_EQ(parse_positions(text).status().code(), ErrorCode::invalid_argument) << "'" << text << "'";
  }
}

std::vector<Triangle> one(const Vec3f& a, const Vec3f& b, const Vec3f& c) { return {{{a, b, c}, 0, 0}}; }

TEST(Lattice, StepIsRoundedDownToAPowerOfTwo) {
  auto triangles = one({0, 0, 0}, {10, 0, 0}, {0, 10, 0});
  EXPECT_EQ(snap_to_lattice(*parse_positions("lattice:0.3"), triangles)->step_exponent, -2);
  EXPECT_EQ(snap_to_lattice(*parse_positions("lattice:4"), triangles)->step_exponent, 2);
}

TEST(Lattice, BitsSpanTheLargestExtent) {
  auto triangles = one({0, 0, 0}, {1000, 0, 0}, {0, 10, 0});
  // 2^e * 2^16 >= 1000 for the first time at e = -6.
  EXPECT_EQ(snap_to_lattice(*parse_positions("lattice:16b"), triangles)->step_exponent, -6);
  auto exact = one({0, 0, 0}, {1024, 0, 0}, {0, 10, 0});
  EXPECT_EQ(snap_to_lattice(*parse_positions("lattice:10b"), exact)->step_exponent, 0);
}

TEST(Lattice, CoordinatesGoToTheNearestStepAndTiesToEven) {
  auto triangles = one({0.5F, 1.5F, 2.5F}, {-0.5F, -1.5F, 0.49F}, {10, 20, -0.4F});
  ASSERT_TRUE(snap_to_lattice(*parse_positions("lattice:1"), triangles));
  EXPECT_EQ(triangles[0].v[0], (Vec3f{0, 2, 2}));
  EXPECT_EQ(triangles[0].v[1], (Vec3f{0, -2, 0}));
  EXPECT_EQ(triangles[0].v[2], (Vec3f{10, 20, 0}));
  for (const Vec3f& p : triangles[0].v) {
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_FALSE(p[axis] == 0 && std::signbit(p[axis])) << "zero on a lattice has no sign";
    }
  }
}

TEST(Lattice, EveryCoordinateIsAMultipleNearTheInputAndSnappingAgainChangesNothing) {
  tests::Random random(11);
  for (const float scale : {1e-30F, 1e-3F, 1.0F, 1e6F, 1e30F}) {
    std::vector<Triangle> triangles = tests::triangles_of({tests::moved(tests::soup(random, 200), {}, scale)});
    const std::vector<Triangle> before = triangles;
    const auto result = snap_to_lattice(*parse_positions("lattice:24b"), triangles);
    ASSERT_TRUE(result);
    ASSERT_EQ(result->dropped_degenerate, 0u);
    const double step = std::ldexp(1.0, result->step_exponent);
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      for (int k = 0; k < 9; ++k) {
        const float value = triangles[i].v[static_cast<std::size_t>(k / 3)][k % 3];
        EXPECT_EQ(std::nearbyint(value / step) * step, value);
        EXPECT_LE(std::abs(double(value) - before[i].v[static_cast<std::size_t>(k / 3)][k % 3]), step / 2);
      }
    }
    EXPECT_LE(result->max_displacement, step * std::sqrt(3.0) / 2);
    std::vector<Triangle> again = triangles;
    PositionsRequest request;
    request.kind = Kind::lattice_step;
    request.step = step;
    if (std::abs(result->step_exponent) <= 120) {
      EXPECT_EQ(snap_to_lattice(request, again)->max_displacement, 0);
    }
  }
}

TEST(Lattice, TrianglesThatCollapseAreDroppedAndTheRestKeepTheirIds) {
  std::vector<Triangle> triangles = tests::triangles_of(
      {{tests::Corners{Vec3f{0, 0, 0}, {0.1F, 0, 0}, {0, 0.1F, 0}}, {Vec3f{0, 0, 0}, {5, 0, 0}, {0, 5, 0}}}});
  const auto result = snap_to_lattice(*parse_positions("lattice:1"), triangles);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->dropped_degenerate, 1u);
  ASSERT_EQ(triangles.size(), 1u);
  EXPECT_EQ(triangles[0].primitive_id, 1u);
}

TEST(Lattice, TooFineAStepIsRefusedWithTheCoordinate) {
  auto triangles = one({0, 0, 0}, {1e6F, 0, 0}, {0, 1, 0});
  const Status status = snap_to_lattice(*parse_positions("lattice:1e-6"), triangles).status();
  EXPECT_EQ(status.code(), ErrorCode::invalid_argument);
  EXPECT_NE(status.message().find("1000000"), std::string::npos) << status.message();
}

TEST(Lattice, OneStepForAllKeepsSharedVerticesShared) {
  std::vector<Triangle> triangles = tests::triangles_of({tests::grid(20, 0.3F)});
  const std::size_t before = tests::vertices_of(tests::grid(20, 0.3F)).size();
  ASSERT_TRUE(snap_to_lattice(*parse_positions("lattice:12b"), triangles));
  tests::Mesh snapped;
  for (const Triangle& t : triangles) {
    snapped.push_back(t.v);
  }
  EXPECT_EQ(tests::vertices_of(snapped).size(), before);
}

}  // namespace
}  // namespace raymill::storage
