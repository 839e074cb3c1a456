#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using WhichVertices = std::vector<int>;

// Two triangles and a quad over five vertices of vertices(): x tells which.
const std::string kTextPly =
    "ply\nformat ascii 1.0\ncomment by hand\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 3\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 1\n1 1 1\n2 4 1\n3 9 1\n4 16 1\n"
    "3 0 1 2\n3 2 3 4\n4 0 1 2 3\n";

// The same file in binary, of either order of bytes.
class BinaryPly {
 public:
  explicit BinaryPly(bool turned) : turned_(turned) {}
  template <typename T>
  BinaryPly& put(T value) {
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    if (turned_) {
      std::reverse(raw, raw + sizeof(T));
    }
    bytes.append(raw, sizeof(T));
    return *this;
  }
  std::string bytes;

 private:
  bool turned_;
};

std::string binary_ply(bool turned, const std::string& line_end = "\n") {
  BinaryPly ply(turned);
  for (const std::string& line :
       {std::string("ply"), "format binary_" + std::string(turned ? "big" : "little") + "_endian 1.0",
        std::string("element vertex 5"), std::string("property double x"), std::string("property uchar red"),
        std::string("property float y"), std::string("property short z"), std::string("element face 3"),
        std::string("property uchar flags"), std::string("property list ushort uint vertex_index"),
        std::string("property list uchar float texcoord"), std::string("end_header")}) {
    ply.bytes += line + line_end;
  }
  for (int i = 0; i < 5; ++i) {
    ply.put(double(i)).put(std::uint8_t{200}).put(float(i * i)).put(std::int16_t{1});
  }
  for (const WhichVertices& face : {WhichVertices{0, 1, 2}, WhichVertices{2, 3, 4}, WhichVertices{0, 1, 2, 3}}) {
    ply.put(std::uint8_t{7}).put(static_cast<std::uint16_t>(face.size()));
    for (const int corner : face) {
      ply.put(static_cast<std::uint32_t>(corner));
    }
    ply.put(std::uint8_t{2}).put(0.5F).put(0.25F);
  }
  return ply.bytes;
}

void expect_the_faces(const Imported& imported) {
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 4U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (WhichVertices{0, 1, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[1]), (WhichVertices{2, 3, 4}));
  EXPECT_EQ(vertex_numbers(imported.triangles[2]), (WhichVertices{0, 1, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[3]), (WhichVertices{0, 2, 3}));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(imported.triangles[i].primitive_id, i);
    EXPECT_EQ(imported.triangles[i].geometry_id, 0U);
    EXPECT_EQ(imported.triangles[i].v[1].z, 1);
  }
  EXPECT_EQ(imported.report.geometries.size(), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::polygons), 1U);
}

TEST(Ply, EncodingsGiveTheSameTriangles) {
  expect_the_faces(import_named("a.ply", kTextPly));
  expect_the_faces(import_named("a.ply", binary_ply(false)));
  expect_the_faces(import_named("a.ply", binary_ply(true)));
}

TEST(Ply, IsKnownByItsFirstBytes) { expect_the_faces(import_named("mesh.glb", kTextPly)); }

TEST(Ply, HeadersOfAnyLineEnd) {
  expect_the_faces(import_named("a.ply", binary_ply(false, "\r\n")));
  expect_the_faces(import_named("a.ply", binary_ply(true, "\r")));
  std::string windows;
  for (const char c : kTextPly) {
    windows += c == '\n' ? "\r\n" : std::string(1, c);
  }
  expect_the_faces(import_named("a.ply", windows));
}

TEST(Ply, FacesMayStandBeforeTheVertices) {
  const std::string ply =
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nelement camera 1\n"
      "property float fov\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
      "3 0 1 2\n45\n0 0 1\n1 1 1\n2 4 1\n";
  const Imported imported = import_named("a.ply", ply);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (WhichVertices{0, 1, 2}));
}

TEST(Ply, StripsBeginAnewAtMinusOne) {
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
      "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
      "0 0 1\n1 1 1\n2 4 1\n3 9 1\n4 16 1\n11 0 1 2 3 -1 2 3 4 -1 0 1\n";
  const Imported imported = import_named("a.ply", ply);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 3U);
  EXPECT_EQ(vertex_numbers(imported.triangles[1]), (WhichVertices{1, 3, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[2]), (WhichVertices{2, 3, 4}));
  EXPECT_EQ(imported.report.counts.at(ImportCode::leftover_vertices), 2U);
}

TEST(Ply, SmallFacesAreCountedAndTakeNoId) {
  std::string ply = kTextPly;
  ply.replace(ply.find("3 0 1 2\n3 2"), 8, "2 0 1\n");
  const Imported imported = import_named("a.ply", ply);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 3U);
  EXPECT_EQ(imported.triangles[0].primitive_id, 0U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::left_out_small_faces), 1U);
}

TEST(Ply, PositionsThatAreNotFiniteDropTheirTriangles) {
  std::string ply = kTextPly;
  ply.replace(ply.find("4 16 1"), 6, "nan -INF 1e999");
  const Imported imported = import_named("a.ply", ply);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_not_finite), 1U);
  ASSERT_EQ(imported.triangles.size(), 3U);
  EXPECT_EQ(imported.triangles[1].primitive_id, 2U);
}

void expect_ply_refused(const std::string& from, const std::string& to, const std::string& sentence,
                        ErrorCode code = ErrorCode::bad_scene) {
  std::string ply = kTextPly;
  ASSERT_NE(ply.find(from), std::string::npos);
  ply.replace(ply.find(from), from.size(), to);
  const Imported imported = import_named("a.ply", ply);
  EXPECT_EQ(imported.status.code(), code) << imported.status.message();
  EXPECT_EQ(imported.status.message(), "a.ply: " + sentence);
}

TEST(Ply, CloudsOfPointsAreRefused) {
  expect_ply_refused("element face 3", "element face 0",
                     "holds 5 vertices and no faces; Raymill traces triangles, so make a mesh of it before",
                     ErrorCode::unsupported);
}

TEST(Ply, BrokenHeaders) {
  expect_ply_refused("ascii 1.0", "ascii 2.0", "is PLY version 2.0 and Raymill reads 1.0", ErrorCode::unsupported);
  expect_ply_refused("ascii", "utf8", "line 2 of its PLY header is no format that PLY knows, or a second one");
  expect_ply_refused("format ascii 1.0\n", "", "its PLY header names no format");
  expect_ply_refused("end_header", "end", "line 10 of its PLY header begins with 'end', which PLY does not know");
  expect_ply_refused("float y", "quad y", "line 6 of its PLY header names the type 'quad', which PLY does not know");
  expect_ply_refused("float y", "float v", "its element 'vertex' has no property 'y'");
  expect_ply_refused("element vertex", "element point", "has no element 'vertex'");
  expect_ply_refused("uchar int", "float int",
                     "line 9 of its PLY header counts a list by a type that is not a whole number");
  expect_ply_refused("uchar int", "uchar float", "its element 'face' has no list 'vertex_indices' of whole numbers");
  expect_ply_refused("element vertex 5", "element vertex -5",
                     "line 4 of its PLY header must be an element, its name and its count");
  expect_ply_refused("element face", "element vertex",
                     "line 8 of its PLY header is an element of a name that there is already, or one too many");
  expect_ply_refused("element face 3\nproperty list uchar int vertex_indices\n", "element face 3\n",
                     "its PLY header gives element 'face' no properties");
  const Imported endless = import_named("a.ply", "ply\nformat ascii 1.0\n");
  EXPECT_EQ(endless.status.message(), "a.ply: its PLY header does not end within 21 bytes");
}

TEST(Ply, CountsThatTheFileCannotHold) {
  expect_ply_refused("element vertex 5", "element vertex 1099511627776",
                     "its PLY header promises 1099511627776 rows of element 'vertex', of at least 3 bytes each, and 57 "
                     "bytes are left; the file is damaged or was cut short");
  expect_ply_refused("element face 3", "element face 4", "face 3: the file ends; it is damaged or was cut short");
  expect_ply_refused("3 0 1 2", "16385 1 2",
                     "face 0: a face has 16385 corners and Raymill takes up to 16384; triangulate it before",
                     ErrorCode::unsupported);
  expect_ply_refused("3 0 1 2", "-3 1 2", "face 0: its list 'vertex_indices' has a count that no list has");
}

TEST(Ply, IndicesPastTheVertices) {
  expect_ply_refused("3 0 1 2", "3 0 1 5", "face 0: refers to vertex 5 and the file has only 5");
  expect_ply_refused("3 2 3 4", "3 2 -1 4", "face 1: refers to vertex -1 and the file has only 5");
  expect_ply_refused("3 2 3 4", "3 2 1.5 4", "face 1: line 7 after its header has '1.5' for a whole number");
  expect_ply_refused("2 4 1\n", "2 four 1\n", "vertex 2: line 3 after its header has 'four' for a number");
}

TEST(Ply, EveryCutIsRefused) {
  const std::string whole = binary_ply(true);
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    EXPECT_EQ(import_named("a.ply", whole.substr(0, bytes)).status.code(), ErrorCode::bad_scene) << bytes;
  }
}

TEST(Ply, VerticesAreClaimedBeforeTheyAreRead) {
  std::string ply = binary_ply(false);
  ply.replace(ply.find("vertex 5"), 8, "vertex 400000");
  ply += std::string(7'000'000, '\0');
  const Imported imported = import_named("a.ply", ply, mebibytes(5));
  EXPECT_EQ(imported.status.code(), ErrorCode::budget_exceeded);
  EXPECT_NE(imported.status.message().find("its 400000 vertices must be held in memory"), std::string::npos)
      << imported.status.message();
}

}  // namespace
}  // namespace raymill::storage
