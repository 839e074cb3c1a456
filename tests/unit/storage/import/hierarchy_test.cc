#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/effort.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using nlohmann::json;

// A scene whose node 0 shows the triangle (1 0 0) (0 1 0) (0 0 1).
TestScene unit_triangle() {
  TestScene scene;
  scene.show(scene.positions({1, 0, 0, 0, 1, 0, 0, 0, 1}));
  return scene;
}

std::vector<float> first_corners(const TestScene& scene, const ImportOptions& options = {}) {
  const Imported imported = import_bytes(scene.text(), options);
  EXPECT_TRUE(imported.status.ok()) << imported.status.message();
  return imported.triangles.empty() ? std::vector<float>() : corners(imported.triangles[0]);
}

TEST(Hierarchy, MatrixIsColumnMajor) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["matrix"] = {0, 2, 0, 0, 3, 0, 0, 0, 0, 0, 4, 0, 10, 20, 30, 1};
  EXPECT_EQ(first_corners(scene), (std::vector<float>{10, 22, 30, 13, 20, 30, 10, 20, 34}));
}

TEST(Hierarchy, ScalesThenRotatesThenTranslates) {
  TestScene scene = unit_triangle();
  const double half = std::sqrt(0.5);
  scene.root["nodes"][0]["scale"] = {2, 3, 4};
  scene.root["nodes"][0]["rotation"] = {0, 0, half, half};  // x becomes y, y becomes -x
  scene.root["nodes"][0]["translation"] = {10, 20, 30};
  const std::vector<float> expected{10, 22, 30, 7, 20, 30, 10, 20, 34};
  const std::vector<float> found = first_corners(scene);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_FLOAT_EQ(found[i], expected[i]);
  }
}

TEST(Hierarchy, QuaternionOfAnyLengthRotatesWithoutScaling) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["rotation"] = {0, 0, 3, 3};
  EXPECT_EQ(first_corners(scene), (std::vector<float>{0, 1, 0, -1, 0, 0, 0, 0, 1}));
}

TEST(Hierarchy, QuaternionWhoseSquaresLeaveFloat64RotatesAsWell) {
  for (const double length : {1e-310, 1e-200, 1e200, 1e308}) {
    TestScene scene = unit_triangle();
    scene.root["nodes"][0]["rotation"] = {0, 0, length, length};
    const std::vector<float> found = first_corners(scene), expected{0, 1, 0, -1, 0, 0, 0, 0, 1};
    ASSERT_EQ(found.size(), expected.size()) << length;
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_NEAR(found[i], expected[i], 1e-7) << length;
    }
  }
}

TEST(Hierarchy, NegativeScaleMirrorsAndKeepsTheOrderOfCorners) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["scale"] = {-1, 2, 1};
  EXPECT_EQ(first_corners(scene), (std::vector<float>{-1, 0, 0, 0, 2, 0, 0, 0, 1}));
}

TEST(Hierarchy, ParentsMultiplyInFloat64) {
  TestScene scene = unit_triangle();
  // 2^30 + 1 and back: lost if any step were rounded to float32.
  scene.root["nodes"][0]["translation"] = {1073741825.0, 0, 0};
  scene.root["nodes"].push_back({{"children", {0}}, {"translation", {-1073741824.0, 5, 0}}});
  scene.root["scenes"][0]["nodes"] = {1};
  EXPECT_EQ(first_corners(scene), (std::vector<float>{2, 5, 0, 1, 6, 0, 1, 5, 1}));
}

TEST(Hierarchy, ScaledToNothingIsDegenerate) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["scale"] = {0, 0, 0};
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok());
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_degenerate), 1U);
}

TEST(Hierarchy, BeyondFloat32IsOutOfRangeAndNotInfinite) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["scale"] = {1e300, 1, 1};
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok());
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_out_of_range), 1U);
}

TEST(Hierarchy, ProjectiveMatrixIsRefused) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["matrix"] = {1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  const Status status = import_bytes(scene.text()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("nodes[0].matrix"), std::string::npos);
}

TEST(Hierarchy, CycleIsRefusedEvenOutsideOfTheScene) {
  TestScene scene = unit_triangle();
  scene.root["nodes"].push_back({{"children", {2}}});
  scene.root["nodes"].push_back({{"children", {3}}});
  scene.root["nodes"].push_back({{"children", {1}}});
  const Status status = import_bytes(scene.text()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("is its own ancestor"), std::string::npos) << status.message();
}

TEST(Hierarchy, NodeThatIsItsOwnChildIsRefused) {
  TestScene scene = unit_triangle();
  scene.root["nodes"][0]["children"] = {0};
  EXPECT_EQ(import_bytes(scene.text()).status.message(),
            "test.gltf: nodes[0] is its own ancestor; a hierarchy must not run in a circle");
}

TEST(Hierarchy, NodeWithTwoParentsIsRefused) {
  TestScene scene = unit_triangle();
  scene.root["nodes"].push_back({{"children", {0}}});
  scene.root["nodes"].push_back({{"children", {0}}});
  scene.root["scenes"][0]["nodes"] = {1, 2};
  const Status status = import_bytes(scene.text()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("nodes[0] is reached twice"), std::string::npos) << status.message();
}

TEST(Hierarchy, MeshSharedByNodesIsOneGeometryForEach) {
  TestScene scene = unit_triangle();
  scene.root["meshes"][0]["name"] = "triangle";
  scene.root["nodes"].push_back({{"mesh", 0}, {"name", "second"}, {"translation", {5, 0, 0}}});
  scene.root["scenes"][0]["nodes"].push_back(1);
  const Imported imported = import_bytes(scene.text());
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(imported.triangles[1].geometry_id, 1U);
  EXPECT_EQ(imported.triangles[1].v[0].x, 6.0F);
  EXPECT_EQ(imported.report.geometries[0].node, "node0");
  EXPECT_EQ(imported.report.geometries[1].node, "second");
  EXPECT_EQ(imported.report.geometries[1].mesh, "triangle");
  EXPECT_EQ(imported.report.geometries[1].file, "test.gltf");
}

TEST(Hierarchy, GeometryIdsFollowTheNodesArrayAndGoOnOverFiles) {
  TestScene scene;
  const int positions = scene.positions({1, 0, 0, 0, 1, 0, 0, 0, 1});
  scene.show(positions);
  scene.show(positions);
  scene.show(positions);
  const json primitive = scene.root["meshes"][1]["primitives"][0];
  scene.root["meshes"][1]["primitives"].push_back(primitive);
  scene.root["nodes"][2]["children"] = {0};  // reached through its parent and numbered before it
  scene.root["scenes"][0]["nodes"] = {2, 1};
  const std::string text = scene.text();

  Imported imported = import_bytes(text);
  ASSERT_EQ(imported.report.geometries.size(), 4U);
  EXPECT_EQ(imported.report.geometries[0].node, "node0");
  EXPECT_EQ(imported.report.geometries[1].node, "node1");
  EXPECT_EQ(imported.report.geometries[2].primitive, 1U);
  EXPECT_EQ(imported.report.geometries[3].node, "node2");

  struct : TriangleSink {
    std::vector<std::uint32_t> ids;
    Status add(std::span<const Triangle> triangles) override {
      for (const Triangle& triangle : triangles) {
        ids.push_back(triangle.geometry_id);
      }
      return {};
    }
  } sink;
  Ledger ledger(mebibytes(64));
  ASSERT_TRUE(
      import_gltf_memory(std::as_bytes(std::span(text)), "second.gltf", {}, ledger, sink, imported.report).ok());
  EXPECT_EQ(sink.ids, (std::vector<std::uint32_t>{4, 5, 6, 7}));
  EXPECT_EQ(imported.report.geometries[7].file, "second.gltf");
  EXPECT_EQ(ledger.used_bytes(Tag::build), 0U);
}

TEST(Hierarchy, SceneIsTheDefaultTheFirstOrTheChosen) {
  TestScene scene = unit_triangle();
  scene.show(scene.positions({7, 0, 0, 0, 1, 0, 0, 0, 1}));
  scene.root["scenes"] = {{{"nodes", {0}}}, {{"nodes", {1}}}};
  scene.root["scene"] = 1;
  EXPECT_EQ(first_corners(scene)[0], 7.0F);
  scene.root.erase("scene");
  EXPECT_EQ(first_corners(scene)[0], 1.0F);
  EXPECT_EQ(first_corners(scene, {.scene = 1})[0], 7.0F);
  const Status status = import_bytes(scene.text(), {.scene = 2}).status;
  EXPECT_EQ(status.code(), ErrorCode::invalid_argument);
  EXPECT_EQ(status.message(), "test.gltf: has no scene 2; it has 2, counted from 0");
}

TEST(Hierarchy, WithoutScenesEveryRootIsShown) {
  TestScene scene = unit_triangle();
  scene.root.erase("scene");
  scene.root.erase("scenes");
  scene.root["nodes"].push_back({{"children", {0}}, {"scale", {2, 2, 2}}});
  EXPECT_EQ(first_corners(scene)[0], 2.0F);
}

TEST(Hierarchy, EmptySceneIsNoError) {
  TestScene scene;
  const Imported imported = import_bytes(scene.text());
  EXPECT_TRUE(imported.status.ok());
  EXPECT_EQ(imported.report.triangles, 0U);
}

TEST(Hierarchy, ChainOfManyNodesNeedsNoStack) {
  TestScene scene = unit_triangle();
  // A call for each would pass the 8 MiB of a stack; sanitized ones are larger.
  constexpr int kDepth = tests::kSanitized ? 20000 : 60000;
  for (int i = 1; i <= kDepth; ++i) {
    scene.root["nodes"].push_back({{"children", {i - 1}}, {"translation", {1, 0, 0}}});
  }
  scene.root["scenes"][0]["nodes"] = {kDepth};
  EXPECT_EQ(first_corners(scene)[0], 1.0F + kDepth);
}

TEST(Hierarchy, CamerasStandInWorldSpace) {
  TestScene scene = unit_triangle();
  scene.root["cameras"] = {{{"type", "perspective"}, {"perspective", {{"yfov", 0.5}, {"znear", 0.1}}}},
                           {{"type", "orthographic"},
                            {"name", "plan"},
                            {"orthographic", {{"xmag", 3}, {"ymag", 2}, {"zfar", 9}, {"znear", 0}}}}};
  scene.root["nodes"].push_back({{"camera", 0}, {"name", "eye"}, {"translation", {1, 2, 3}}});
  scene.root["nodes"].push_back({{"camera", 1}});
  scene.root["scenes"][0]["nodes"] = {0, 1, 2};
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.report.cameras.size(), 2U);
  EXPECT_EQ(imported.report.cameras[0].name, "eye");
  EXPECT_TRUE(imported.report.cameras[0].perspective);
  EXPECT_EQ(imported.report.cameras[0].yfov_radians, 0.5);
  EXPECT_EQ(imported.report.cameras[0].aspect_ratio, 0.0);
  EXPECT_EQ(imported.report.cameras[0].world_from_camera[13], 2.0);
  EXPECT_EQ(imported.report.cameras[1].name, "plan");
  EXPECT_FALSE(imported.report.cameras[1].perspective);
  EXPECT_EQ(imported.report.cameras[1].ymag, 2.0);
}

}  // namespace
}  // namespace raymill::storage
