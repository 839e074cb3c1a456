// Scenes that lie far out: which origin they ask for, and that nothing is rounded before it is subtracted.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>

#include "storage/import/scene_origin.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using tests::TempFolder;
using Point = std::array<double, 3>;

Origin chosen(const std::string& name, const std::string& bytes) {
  const TempFolder folder;
  tests::write_file(folder / name, bytes);
  Ledger ledger(gibibytes(1));
  const auto origin = choose_origin(folder / name, {}, ledger, [] { return Status(); });
  EXPECT_TRUE(origin.ok()) << origin.status().message();
  return origin.ok() ? *origin : Origin();
}

Imported imported_about(const std::string& name, const std::string& bytes, const Point& origin) {
  ImportOptions options;
  options.origin = origin;
  const Imported imported = import_bytes(bytes, options, gibibytes(1), name);
  EXPECT_TRUE(imported.status.ok()) << imported.status.message();
  return imported;
}

TestScene unit_triangle(const std::vector<double>& translation) {
  TestScene scene;
  scene.show(scene.positions({1, 0, 0, 0, 1, 0, 0, 0, 1}));
  if (!translation.empty()) {
    scene.root["nodes"][0]["translation"] = translation;
  }
  return scene;
}

TEST(Origin, OfAGltfComesFromItsNodes) {
  EXPECT_TRUE(chosen("a.gltf", unit_triangle({}).text()).is_zero());
  EXPECT_TRUE(chosen("a.gltf", unit_triangle({20, 30, 40}).text()).is_zero()) << "not far for its size";
  TestScene far = unit_triangle({4500000.25, -0.125, 6e6});
  EXPECT_EQ(chosen("a.gltf", far.text()).position(), (Point{4500000, 0, 6000000}));
  EXPECT_EQ(chosen("a.glb", far.glb()).position(), (Point{4500000, 0, 6000000}));
  // A second one at zero: the scene is as large as it is far.
  far.show(far.positions({1, 0, 0, 0, 1, 0, 0, 0, 1}));
  EXPECT_TRUE(chosen("a.gltf", far.text()).is_zero());
  // Positions that were float32 where they stand have lost what there was to lose.
  TestScene baked;
  baked.show(baked.positions({1e7F, 0, 0, 1e7F, 1, 0, 1e7F, 0, 1}));
  EXPECT_TRUE(chosen("a.gltf", baked.text()).is_zero());
}

TEST(Origin, IsSubtractedFromWhatAGltfPlaces) {
  const TestScene scene = unit_triangle({4500000.0009765625, -7, 6e6});
  const Imported imported = imported_about("a.gltf", scene.text(), {4500000, 0, 6e6});
  ASSERT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(corners(imported.triangles[0]),
            (std::vector<float>{1.0009765625F, -7, 0, 0.0009765625F, -6, 0, 0.0009765625F, -7, 1}));
}

// Of which float32 in world space would leave no triangle.
TEST(Origin, OfASceneThatIsSmallForWhereItLies) {
  const std::string tiny =
      "v 4500000.001 4500000.001 -7\nv 4500000.002 4500000.002 -7\nv 4500000.003 4500000.001 -7.001\nf 1 2 3\n";
  const Origin origin = chosen("a.obj", tiny);
  EXPECT_NEAR(origin.position()[0], 4500000.002, 0.004);
  EXPECT_EQ(imported_about("a.obj", tiny, origin.position()).triangles.size(), 1U);
  EXPECT_EQ(imported_about("a.obj", tiny, {}).triangles.size(), 0U);
}

constexpr const char* kFarObj = "v 4500000.001 0 -7\nv 4500000.002 1 -7\nv 4500000.003 0 -6\nf 1 2 3\n";

TEST(Origin, OfWordsIsThatOfTheirNumbers) {
  EXPECT_TRUE(chosen("a.obj", "v 100.001 0 -7\nv 100.002 1 -7\nv 100.003 0 -6\nf 1 2 3\n").is_zero());
  EXPECT_TRUE(chosen("a.obj", "v 4500000 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n").is_zero()) << "large";
  EXPECT_EQ(chosen("a.obj", kFarObj).position(), (Point{4500000, 0, -6}));
  const std::string stl =
      "solid\nfacet normal 0 0 0\nouter loop\nvertex 4500000.001 0 -7\nvertex 4500000.002 1 -7\n"
      "vertex 4500000.003 0 -6\nendloop\nendfacet\nendsolid\n";
  EXPECT_EQ(chosen("a.stl", stl).position(), (Point{4500000, 0, -6}));
  const Point origin{4500000, 0, -6};
  const std::vector<float> expected{static_cast<float>(4500000.001 - 4500000), 0, -1,
                                    static_cast<float>(4500000.002 - 4500000), 1, -1,
                                    static_cast<float>(4500000.003 - 4500000), 0, 0};
  const std::vector<std::pair<std::string, std::string>> files{{"a.obj", kFarObj}, {"a.stl", stl}};
  for (const auto& [name, bytes] : files) {
    const Imported imported = imported_about(name, bytes, origin);
    ASSERT_EQ(imported.triangles.size(), 1U) << name;
    EXPECT_EQ(corners(imported.triangles[0]), expected) << name;
  }
}

std::string ply(const std::string& type, const std::string& format, const std::string& body) {
  return "ply\nformat " + format + " 1.0\nelement vertex 3\nproperty " + type + " x\nproperty " + type +
         " y\nproperty " + type + " z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n" + body;
}

TEST(Origin, OfAPlyComesFromFloat64AndWords) {
  const std::string words = "4500000.001 0 -7\n4500000.002 1 -7\n4500000.003 0 -6\n3 0 1 2\n";
  std::string doubles, floats;
  for (const double x : {4500000.001, 0.0, -7.0, 4500000.002, 1.0, -7.0, 4500000.003, 0.0, -6.0}) {
    doubles.append(reinterpret_cast<const char*>(&x), sizeof x);
    const auto narrow = static_cast<float>(x);
    floats.append(reinterpret_cast<const char*>(&narrow), sizeof narrow);
  }
  const char face[13] = {3, 0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0};
  doubles.append(face, sizeof face);
  floats.append(face, sizeof face);
  const std::string text = ply("double", "ascii", words), wide = ply("double", "binary_little_endian", doubles);
  EXPECT_EQ(chosen("a.ply", text).position(), (Point{4500000, 0, -6}));
  EXPECT_EQ(chosen("a.ply", wide).position(), (Point{4500000, 0, -6}));
  EXPECT_TRUE(chosen("a.ply", ply("float", "binary_little_endian", floats)).is_zero()) << "nothing is left to keep";
  for (const std::string& bytes : {text, wide}) {
    const Imported imported = imported_about("a.ply", bytes, {4500000, 0, -6});
    ASSERT_EQ(imported.triangles.size(), 1U);
    EXPECT_EQ(corners(imported.triangles[0])[0], static_cast<float>(4500000.001 - 4500000));
    EXPECT_EQ(corners(imported.triangles[0])[6], static_cast<float>(4500000.003 - 4500000));
  }
}

TEST(Origin, IsReadAsItIsWritten) {
  EXPECT_FALSE(parse_origin("auto")->has_value());
  EXPECT_TRUE(parse_origin("none")->value().is_zero());
  EXPECT_TRUE(parse_origin("0,0,0")->value().is_zero());
  EXPECT_EQ(parse_origin("500000,0,5200000.5")->value().position(), (Point{500000, 0, 5200000.5}));
  EXPECT_NEAR(parse_origin("-0.1,0,0")->value().position()[0], -0.1, 0.1 * 0x1p-30);
  for (const char* bad : {"", "1,2", "1,2,3,4", "1,2,x", "nan,0,0", "inf,0,0", "1e300,0,0", "1;2;3", "1,2,3 "}) {
    EXPECT_EQ(parse_origin(bad).status().code(), ErrorCode::invalid_argument) << bad;
  }
}

TEST(Origin, ErrorsAreThoseOfTheImport) {
  const TempFolder folder;
  Ledger ledger(gibibytes(1));
  const auto go_on = [] { return Status(); };
  EXPECT_EQ(choose_origin(folder / "none.gltf", {}, ledger, go_on).status().code(), ErrorCode::not_found);
  tests::write_file(folder / "bad.obj", "v 4500000 0 0\nv 4500000 1 0\nv 4500000 0 1\nf 1 2 9\n");
  const Status bad = choose_origin(folder / "bad.obj", {}, ledger, go_on).status();
  EXPECT_EQ(bad.code(), ErrorCode::bad_scene);
  EXPECT_NE(bad.message().find("bad.obj"), std::string::npos) << bad.message();
  tests::write_file(folder / "far.obj", kFarObj);
  const auto stop = [] { return Status(ErrorCode::interrupted, "stopped"); };
  EXPECT_EQ(choose_origin(folder / "far.obj", {}, ledger, stop).status().code(), ErrorCode::interrupted);
}

}  // namespace
}  // namespace raymill::storage
