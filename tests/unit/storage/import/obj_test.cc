#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using WhichVertices = std::vector<int>;

const std::string kVertices = "v 0 0 1\nv 1 1 1\nv 2 4 1\nv 3 9 1\nv 4 16 1\n";

TEST(Obj, FacesOfEveryForm) {
  const Imported imported = import_named(
      "a.obj",
      "# by hand\nmtllib none.mtl\n" + kVertices +
          "vt 0 0\nvn 0 0 1\nf 1 2 3\nf 2/1 3/1 4/1 # a comment\nf 3//1 4//1 5//1\r\nf 1/1/1 \\\n 3/1/1 5/1/1\n");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 4U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (WhichVertices{0, 1, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[1]), (WhichVertices{1, 2, 3}));
  EXPECT_EQ(vertex_numbers(imported.triangles[2]), (WhichVertices{2, 3, 4}));
  EXPECT_EQ(vertex_numbers(imported.triangles[3]), (WhichVertices{0, 2, 4}));
  EXPECT_EQ(imported.triangles[3].primitive_id, 3U);
}

TEST(Obj, NegativeIndicesCountBackFromTheFace) {
  const Imported imported =
      import_named("a.obj", "v 0 0 1\nv 1 1 1\nv 2 4 1\nf -3 -2 -1\nv 3 9 1\nv 4 16 1\nf -3 -2 -1\n");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (WhichVertices{0, 1, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[1]), (WhichVertices{2, 3, 4}));
}

TEST(Obj, FacesMayNameVerticesThatComeLater) {
  const Imported imported = import_named("a.obj", "f 1 2 3\n" + kVertices);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.triangles.size(), 1U);
}

TEST(Obj, ObjectsGroupsAndMaterialsAreGeometries) {
  const Imported imported = import_named(
      "a.obj", kVertices + "f 1 2 3\no car\ng wheel left\nusemtl rubber\nf 2 3 4\nusemtl paint\nf 3 4 5\n" +
                   "usemtl rubber\nf 1 2 4 5\ng\no\nusemtl\nf 1 3 5\ng roof\ng none\ng top\nf 1 2 5\n");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  const std::vector<GeometryInfo>& geometries = imported.report.geometries;
  ASSERT_EQ(geometries.size(), 4U);
  EXPECT_EQ(geometries[0].node, "node0");
  EXPECT_EQ(geometries[0].mesh, "mesh0");
  EXPECT_EQ(geometries[0].triangles, 2U);  // it came again without names
  EXPECT_EQ(geometries[1].node, "car/wheel left");
  EXPECT_EQ(geometries[1].mesh, "rubber");
  EXPECT_EQ(geometries[1].triangles, 3U);
  EXPECT_EQ(geometries[2].mesh, "paint");
  EXPECT_EQ(geometries[3].node, "top");
  ASSERT_EQ(imported.triangles.size(), 7U);
  EXPECT_EQ(imported.triangles[3].geometry_id, 1U);
  EXPECT_EQ(imported.triangles[3].primitive_id, 1U);
  EXPECT_EQ(imported.triangles[5].geometry_id, 0U);
  EXPECT_EQ(imported.triangles[5].primitive_id, 1U);
}

TEST(Obj, WhatIsNoFaceIsCounted) {
  const Imported imported =
      import_named("a.obj", kVertices + "p 1 2\nl 1 2 3\nf 1 2\nf\ncurv 0 1 1 2\nsurf 0 1 0 1 1 2\nf 1 2 3\n");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_points), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_lines), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_small_faces), 2U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_curves), 2U);
}

TEST(Obj, AByteOrderMarkHidesNoVertex) {
  const Imported imported = import_named("a.obj", "\xEF\xBB\xBF" + kVertices + "f 1 2 3\n");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(vertex_numbers(imported.triangles.at(0)), (WhichVertices{0, 1, 2}));
}

TEST(Obj, VerticesMayCarryWeightsAndColours) {
  const Imported imported = import_named("a.obj", "v 0 0 1 1\nv 1 1 1 0.5 0.5 0.5\nv +2 4e0 .1e1\nf 1 2 3");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(corners(imported.triangles[0]), (std::vector<float>{0, 0, 1, 1, 1, 1, 2, 4, 1}));
}

TEST(Obj, PositionsThatAreNotFiniteDropTheirTriangles) {
  const Imported imported = import_named("a.obj", kVertices + "v nan 0 0\nv 0 inf 0\nf 1 2 6\nf 1 2 3 7\nf 1 2 3\n");
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_not_finite), 2U);
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(imported.triangles[0].primitive_id, 1U);
  EXPECT_EQ(imported.triangles[1].primitive_id, 3U);
}

void expect_obj_refused(const std::string& text, const std::string& sentence, ErrorCode code = ErrorCode::bad_scene) {
  const Imported imported = import_named("a.obj", text);
  EXPECT_EQ(imported.status.code(), code) << imported.status.message();
  EXPECT_EQ(imported.status.message(), "a.obj: " + sentence);
}

TEST(Obj, BrokenLines) {
  expect_obj_refused(kVertices + "f 1 2 6\n", "line 6: a face refers to vertex 6 and there are 5, counted from 1");
  expect_obj_refused(kVertices + "f 0 1 2\n", "line 6: a face refers to vertex 0 and there are 5, counted from 1");
  expect_obj_refused("v 0 0 0\nf -1 -2 -3\nv 1 0 0\nv 1 1 0\n",
                     "line 2: a face refers to vertex -2 and there are 1 before it");
  expect_obj_refused(kVertices + "f 1 2 -9223372036854775808\n",
                     "line 6: a face refers to vertex -9223372036854775808 and there are 5 before it");
  expect_obj_refused(kVertices + "f 1 2 x\n", "line 6: a corner is 'x', which is no number");
  expect_obj_refused(kVertices + "f 1 2 3/a\n", "line 6: a corner is '3/a', which is no number");
  expect_obj_refused(kVertices + "f 1 2 99999999999999999999\n",
                     "line 6: a corner is '99999999999999999999', which is no number");
  expect_obj_refused("v 0 0\nf 1 1 1\n", "line 1: a coordinate is '', which is no number");
  expect_obj_refused("v 0 0 zero\n", "line 1: a coordinate is 'zero', which is no number");
}

TEST(Obj, CloudsOfPointsAndOtherTextAreRefused) {
  expect_obj_refused(kVertices, "holds 5 vertices and no faces; Raymill traces triangles, so make a mesh of it before",
                     ErrorCode::unsupported);
  expect_obj_refused("a letter\n",
                     "holds 0 vertices and no faces; Raymill traces triangles, so make a mesh of it before",
                     ErrorCode::unsupported);
}

TEST(Obj, FacesOfTooManyCorners) {
  std::string face = "f";
  for (int i = 0; i < 16385; ++i) {
    face += " 1";
  }
  expect_obj_refused(kVertices + face,
                     "line 6: a face has 16385 corners and Raymill takes up to 16384; triangulate it before",
                     ErrorCode::unsupported);
}

TEST(Obj, GroupsHaveALimit) {
  std::string text = kVertices;
  for (int i = 0; i < 65537; ++i) {
    text += "g g" + std::to_string(i) + "\nf 1 2 3\n";
  }
  expect_obj_refused(text,
                     "line 131079: has more than 65536 groups of faces, each of which would be a geometry; join some",
                     ErrorCode::unsupported);
}

TEST(Obj, VerticesAreClaimed) {
  std::string text;
  for (int i = 0; i < 600000; ++i) {
    text += "v 1 2 3\n";
  }
  const Imported imported = import_named("a.obj", text + "f 1 2 3\n", mebibytes(6));
  EXPECT_EQ(imported.status.code(), ErrorCode::budget_exceeded);
  EXPECT_NE(imported.status.message().find("its 600000 vertices must be held in memory"), std::string::npos)
      << imported.status.message();
}

}  // namespace
}  // namespace raymill::storage
