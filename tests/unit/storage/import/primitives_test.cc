#include <gtest/gtest.h>

#include <limits>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using Numbers = std::vector<std::vector<int>>;

Numbers shown(const Imported& imported) {
  Numbers numbers;
  for (const Triangle& triangle : imported.triangles) {
    numbers.push_back(vertex_numbers(triangle));
  }
  return numbers;
}

template <typename T>
Imported import_indexed(const std::vector<T>& indices, int mode, int vertex_count) {
  TestScene scene;
  const int positions = scene.positions(vertices(vertex_count));
  scene.show(positions, scene.indices(indices), mode);
  return import_bytes(scene.text());
}

Imported import_unindexed(int mode, int vertex_count) {
  TestScene scene;
  scene.show(scene.positions(vertices(vertex_count)), -1, mode);
  return import_bytes(scene.text());
}

TEST(Primitives, ListWithoutIndices) {
  const Imported imported = import_unindexed(4, 6);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(shown(imported), (Numbers{{0, 1, 2}, {3, 4, 5}}));
}

TEST(Primitives, StripTurnsEverySecondTriangle) {
  const Imported imported = import_unindexed(5, 6);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(shown(imported), (Numbers{{0, 1, 2}, {1, 3, 2}, {2, 3, 4}, {3, 5, 4}}));
}

TEST(Primitives, StripOfASquareWindsOneWay) {
  TestScene scene;
  scene.show(scene.positions({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 2, 0}), -1, 5);
  const Imported imported = import_bytes(scene.text());
  ASSERT_EQ(imported.triangles.size(), 3U);
  for (const Triangle& t : imported.triangles) {
    const float area = (t.v[1].x - t.v[0].x) * (t.v[2].y - t.v[0].y) - (t.v[1].y - t.v[0].y) * (t.v[2].x - t.v[0].x);
    EXPECT_GT(area, 0);
  }
}

TEST(Primitives, FanTurnsAroundItsFirstVertex) {
  const Imported imported = import_unindexed(6, 5);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(shown(imported), (Numbers{{1, 2, 0}, {2, 3, 0}, {3, 4, 0}}));
}

TEST(Primitives, IndicesOfEveryType) {
  const Numbers expected{{3, 2, 1}, {0, 1, 3}};
  EXPECT_EQ(shown(import_indexed(std::vector<std::uint8_t>{3, 2, 1, 0, 1, 3}, 4, 4)), expected);
  EXPECT_EQ(shown(import_indexed(std::vector<std::uint16_t>{3, 2, 1, 0, 1, 3}, 4, 4)), expected);
  EXPECT_EQ(shown(import_indexed(std::vector<std::uint32_t>{3, 2, 1, 0, 1, 3}, 4, 4)), expected);
}

TEST(Primitives, IndexedStripAndFan) {
  const std::vector<std::uint16_t> indices{4, 0, 2, 1};
  EXPECT_EQ(shown(import_indexed(indices, 5, 5)), (Numbers{{4, 0, 2}, {0, 1, 2}}));
  EXPECT_EQ(shown(import_indexed(indices, 6, 5)), (Numbers{{0, 2, 4}, {2, 1, 4}}));
}

TEST(Primitives, RestartValueIsRefused) {
  for (const int mode : {4, 5, 6}) {
    const Imported imported = import_indexed(std::vector<std::uint8_t>{0, 1, 255}, mode, 4);
    EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene);
    EXPECT_NE(imported.status.message().find("restart value 255 at 2"), std::string::npos) << imported.status.message();
  }
  EXPECT_FALSE(import_indexed(std::vector<std::uint16_t>{0, 1, 65535}, 4, 4).status.ok());
  EXPECT_FALSE(import_indexed(std::vector<std::uint32_t>{0, 1, 4294967295}, 4, 4).status.ok());
}

TEST(Primitives, IndexPastTheVerticesIsRefused) {
  const Imported imported = import_indexed(std::vector<std::uint16_t>{0, 1, 4}, 4, 4);
  EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(
      imported.status.message(),
      "test.gltf: meshes[0].primitives[0]: accessors[1] holds index 4 at 2 and the primitive has only 4 vertices");
}

TEST(Primitives, LeftoverVerticesAreCounted) {
  EXPECT_EQ(import_unindexed(4, 5).report.counts.at(ImportCode::leftover_vertices), 2U);
  EXPECT_EQ(import_unindexed(5, 2).report.counts.at(ImportCode::leftover_vertices), 2U);
  EXPECT_EQ(import_unindexed(6, 1).report.counts.at(ImportCode::leftover_vertices), 1U);
  EXPECT_FALSE(import_unindexed(5, 7).report.counts.contains(ImportCode::leftover_vertices));
}

TEST(Primitives, PointsAndLinesAreLeftOutAndKeepTheirGeometryIds) {
  TestScene scene;
  const int positions = scene.positions(vertices(6));
  for (const int mode : {0, 1, 2, 3, 4}) {
    scene.show(positions, -1, mode);
  }
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok());
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_points), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_lines), 3U);
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(imported.triangles[0].geometry_id, 4U);
  ASSERT_EQ(imported.report.geometries.size(), 5U);
  EXPECT_EQ(imported.report.geometries[4].triangles, 2U);
  EXPECT_EQ(imported.report.geometries[0].triangles, 0U);
}

TEST(Primitives, UnknownModeIsRefused) { EXPECT_EQ(import_unindexed(7, 3).status.code(), ErrorCode::bad_scene); }

TEST(Primitives, WithoutPositionsAreLeftOut) {
  TestScene scene;
  const int node = scene.show(scene.positions(vertices(3)));
  scene.root["meshes"][node]["primitives"][0]["attributes"] = nlohmann::json::object();
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_no_positions), 1U);
}

TEST(Primitives, PrimitiveIdsCountDroppedTriangles) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  TestScene scene;
  const int positions = scene.positions({0, 0, 0, 1, 0, 0, 0, 1, 0, 5, 5, 5, 7, 7, 7});
  scene.show(positions, scene.indices(std::vector<std::uint8_t>{0, 0, 1, 0, 1, 2, 3, 4, 4, 2, 1, 0}));
  scene.show(scene.positions({0, 0, 0, 1, 0, kNan, 0, 1, 0, 0, 0, 0, kInfinity, 0, 0, 0, 1, 0,
                              0, 0, 0, 1, 0, 0,    0, 1, 0, 0, 0, 0, 2e36F,     0, 0, 0, 1, 0}));
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 3U);
  EXPECT_EQ(imported.triangles[0].primitive_id, 1U);
  EXPECT_EQ(imported.triangles[1].primitive_id, 3U);
  EXPECT_EQ(imported.triangles[2].primitive_id, 2U);
  EXPECT_EQ(imported.triangles[2].geometry_id, 1U);
  EXPECT_EQ(imported.report.triangles, 8U);
  EXPECT_EQ(imported.report.kept, 3U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_degenerate), 2U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_not_finite), 2U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_out_of_range), 1U);
}

TEST(Primitives, ManyTrianglesComeInPieces) {
  for (const int mode : {4, 5, 6}) {
    const Imported imported = import_unindexed(mode, mode == 4 ? 210000 : 70002);
    ASSERT_TRUE(imported.status.ok()) << imported.status.message();
    EXPECT_EQ(imported.report.triangles, 70000U);
    EXPECT_LE(imported.largest_piece, 65536U);
    std::uint32_t expected = 0;
    for (const Triangle& triangle : imported.triangles) {
      ASSERT_GE(triangle.primitive_id, expected);
      expected = triangle.primitive_id + 1;
    }
  }
}

TEST(Primitives, MorphTargetsAndSkinsAreTakenAtRest) {
  TestScene scene;
  const int node = scene.show(scene.positions(vertices(3)));
  scene.root["meshes"][node]["primitives"][0]["targets"] = {{{"POSITION", 0}}};
  scene.root["skins"] = {{{"joints", {0}}}};
  scene.root["nodes"][node]["skin"] = 0;
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::morph_at_rest), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::skin_at_rest), 1U);
}

}  // namespace
}  // namespace raymill::storage
