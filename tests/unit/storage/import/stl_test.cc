#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using WhichVertices = std::vector<int>;

const std::string kTextStl =
    "solid first part\n"
    "  facet normal 0 0 1\n    outer loop\n      vertex 0 0 1\n      vertex 1 1 1\n      vertex 2 4 1\n    endloop\n"
    "  endfacet\n"
    "  FACET NORMAL 0 0 0\n OUTER LOOP\n VERTEX 1 1 1\n VERTEX 2 4 1\n VERTEX 3 9 1\n ENDLOOP\n ENDFACET\n"
    "endsolid first part\n"
    "solid\nfacet\nouter loop\nvertex 2 4 1 vertex 3 9 1 vertex 4 16 1\nendloop endfacet endsolid\n";

std::string binary_stl(const std::vector<std::vector<float>>& facets, const std::string& head = "made by hand") {
  std::string bytes = head;
  bytes.resize(80, ' ');
  const auto count = static_cast<std::uint32_t>(facets.size());
  bytes.append(reinterpret_cast<const char*>(&count), sizeof count);
  for (const std::vector<float>& facet : facets) {
    bytes.append(12, '\x7F');  // a normal that means nothing
    bytes.append(reinterpret_cast<const char*>(facet.data()), facet.size() * sizeof(float));
    bytes.append(2, '\xFF');
  }
  return bytes;
}

const std::vector<std::vector<float>> kFacets = {{0, 0, 1, 1, 1, 1, 2, 4, 1}, {1, 1, 1, 2, 4, 1, 3, 9, 1}};

TEST(Stl, SolidsInWordsAreGeometries) {
  const Imported imported = import_named("a.stl", kTextStl);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 3U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (WhichVertices{0, 1, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[1]), (WhichVertices{1, 2, 3}));
  EXPECT_EQ(vertex_numbers(imported.triangles[2]), (WhichVertices{2, 3, 4}));
  EXPECT_EQ(imported.triangles[1].primitive_id, 1U);
  EXPECT_EQ(imported.triangles[2].primitive_id, 0U);
  EXPECT_EQ(imported.triangles[2].geometry_id, 1U);
  ASSERT_EQ(imported.report.geometries.size(), 2U);
  EXPECT_EQ(imported.report.geometries[0].node, "first part");
  EXPECT_EQ(imported.report.geometries[1].node, "node1");
}

void expect_the_facets(const Imported& imported) {
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (WhichVertices{0, 1, 2}));
  EXPECT_EQ(vertex_numbers(imported.triangles[1]), (WhichVertices{1, 2, 3}));
  EXPECT_EQ(imported.triangles[1].primitive_id, 1U);
}

TEST(Stl, BinaryFacets) { expect_the_facets(import_named("a.stl", binary_stl(kFacets))); }

TEST(Stl, ABinaryFileMayBeginWithSolid) {
  expect_the_facets(import_named("a.stl", binary_stl(kFacets, "solid by a program that should know better")));
  expect_the_facets(import_named("without a name", binary_stl(kFacets, "solid")));
}

TEST(Stl, FacetsThatAreNotFiniteAreDropped) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Imported imported =
      import_named("a.stl", binary_stl({{0, 0, 1, nan, 1, 1, 2, 4, 1}, {0, 0, 1, 1, 1, 1, 2, 4, 1e38F}, kFacets[0]}));
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_not_finite), 1U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_out_of_range), 1U);
  ASSERT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(imported.triangles[0].primitive_id, 2U);
}

void expect_stl_refused(const std::string& bytes, const std::string& sentence) {
  const Imported imported = import_named("a.stl", bytes);
  EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene) << imported.status.message();
  EXPECT_EQ(imported.status.message(), "a.stl: " + sentence);
}

TEST(Stl, BinaryFilesOfAWrongLength) {
  const std::string whole = binary_stl(kFacets, "solid ");
  const std::string promise = "its STL header promises 2 facets of 50 bytes and ";
  const std::string damaged = " bytes follow; the file is damaged or was cut short";
  expect_stl_refused(whole.substr(0, whole.size() - 1), promise + "99" + damaged);
  expect_stl_refused(whole + "x", promise + "101" + damaged);
  expect_stl_refused("", "holds only 0 bytes; a binary STL has 84 at least");
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    EXPECT_EQ(import_named("a.stl", whole.substr(0, bytes)).status.code(), ErrorCode::bad_scene) << bytes;
  }
}

TEST(Stl, BrokenWords) {
  const auto changed = [](const std::string& from, const std::string& to) {
    std::string text = kTextStl;
    text.replace(text.find(from), from.size(), to);
    return text;
  };
  expect_stl_refused(changed("vertex 1 1 1", "vertex 1 1"), "line 6: 'vertex' stands where 'a number' should");
  expect_stl_refused(changed("    endloop", "vertex 4 16 1 endloop"), "line 7: 'vertex' stands where 'endloop' should");
  expect_stl_refused(changed("outer loop", "outer"), "line 4: 'vertex' stands where 'loop' should");
  expect_stl_refused(changed("endsolid first part", "colour"), "line 16: 'colour' stands where 'facet' should");
  expect_stl_refused(kTextStl + "rest", "line 22: 'rest' stands where 'solid' should");
  expect_stl_refused(kTextStl.substr(0, kTextStl.find("vertex 1 1 1")),
                     "ends where 'vertex' should stand; it was cut short");
}

TEST(Stl, AFileCutBetweenFacetsIsRefused) {
  expect_stl_refused(kTextStl.substr(0, kTextStl.find("endsolid")),
                     "ends where 'facet' should stand; it was cut short");
}

}  // namespace
}  // namespace raymill::storage
