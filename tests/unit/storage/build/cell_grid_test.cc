#include "storage/build/cell_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "storage/build/triangle_bucket.h"
#include "tests/support/scenes.h"

namespace raymill::storage {
namespace {

using tests::Mesh;
using tests::Random;

struct Counted {
  std::vector<Aabb> boxes;
  CellGrid grid;
  std::vector<CellNode> nodes;
};

Counted count(const Mesh& mesh, std::uint64_t run_triangles) {
  std::vector<Aabb> boxes;
  Aabb middles;
  for (const Triangle& t : tests::triangles_of({mesh})) {
    boxes.push_back(bounds(t));
    middles.grow(middle(boxes.back()));
  }
  CellGrid grid(middles, boxes.size());
  for (const Aabb& box : boxes) {
    grid.add(grid.cell_of(middle(box)), box);
  }
  std::vector<CellNode> nodes = grid.partition(run_triangles);
  return {std::move(boxes), std::move(grid), std::move(nodes)};
}

// What must hold for any scene: the tree is one, and each triangle is counted in exactly one leaf, with its box.
void check(const Counted& counted, std::uint64_t run_triangles) {
  std::map<std::uint32_t, std::size_t> leaf_of_cell;
  std::vector<int> parents(counted.nodes.size());
  for (std::size_t i = 0; i < counted.nodes.size(); ++i) {
    const CellNode& node = counted.nodes[i];
    const auto cells = counted.grid.cells_of(node);
    if (!node.is_leaf()) {
      const CellNode& left = counted.nodes[node.left];
      const CellNode& right = counted.nodes[node.right];
      EXPECT_GT(node.left, i) << "parents stand first";
      EXPECT_GT(node.right, i);
      ++parents[node.left];
      ++parents[node.right];
      EXPECT_EQ(node.count, left.count + right.count);
      EXPECT_EQ(node.cell_count, left.cell_count + right.cell_count);
      EXPECT_GT(left.count, 0u);
      EXPECT_GT(right.count, 0u);
      EXPECT_GT(node.count, run_triangles) << "what is small enough is not cut";
      continue;
    }
    EXPECT_TRUE(node.count <= run_triangles || node.cell_count < 48) << node.count << " in " << node.cell_count;
    for (const std::uint32_t cell : cells) {
      ASSERT_LT(cell, counted.grid.cell_count());
      EXPECT_TRUE(leaf_of_cell.emplace(cell, i).second) << "cell " << cell << " is in two leaves";
    }
  }
  EXPECT_EQ(parents[0], 0);
  EXPECT_TRUE(std::all_of(parents.begin() + 1, parents.end(), [](int n) { return n == 1; }));
  std::vector<CellNode> found(counted.nodes.size());
  for (const Aabb& box : counted.boxes) {
    const auto leaf = leaf_of_cell.find(counted.grid.cell_of(middle(box)));
    ASSERT_NE(leaf, leaf_of_cell.end()) << "a triangle is in no leaf";
    found[leaf->second].box.grow(box);
    ++found[leaf->second].count;
  }
  EXPECT_EQ(counted.nodes[0].count, counted.boxes.size());
  for (std::size_t i = 0; i < counted.nodes.size(); ++i) {
    if (counted.nodes[i].is_leaf()) {
      EXPECT_EQ(counted.nodes[i].count, found[i].count);
      EXPECT_EQ(counted.nodes[i].box, found[i].box);
    }
  }
}

TEST(CellGrid, EveryTriangleIsInOneLeafWhateverTheScene) {
  Random random(1);
  Mesh every_scale;
  for (int e = -30; e <= 30; e += 3) {
    const Mesh part = tests::moved(tests::soup(random, 300), {}, std::pow(10.0F, float(e)));
    every_scale.insert(every_scale.end(), part.begin(), part.end());
  }
  for (const Mesh& mesh :
       {tests::soup(random, 20000), tests::grid(100, 0.1F), tests::needles(random, 5000), tests::nested_shells(5000),
        tests::collinear(5000), tests::moved(tests::soup(random, 5000), {}, 1e36F),
        tests::moved(tests::soup(random, 5000), {}, 1e-36F), every_scale, tests::soup(random, 1)}) {
    for (const std::uint64_t run_triangles : {64u, 1000u, 100000u}) {
      check(count(mesh, run_triangles), run_triangles);
    }
  }
}

TEST(CellGrid, PartsHaveAnEighthOfARunWhereAPlaneAllowsIt) {
  Random random(2);
  // A few far off, which the heuristic alone would cut off at once.
  Mesh few_far_off = tests::soup(random, 50000);
  for (const float side : {-6.0F, 6.0F}) {
    const Mesh few = tests::moved(tests::soup(random, 20), {side, 0, 0}, 0.1F);
    few_far_off.insert(few_far_off.end(), few.begin(), few.end());
  }
  for (const Mesh& mesh :
       {tests::soup(random, 100000), tests::needles(random, 50000), tests::grid(200, 0.1F), few_far_off}) {
    for (const std::uint64_t run_triangles : {1000u, 5000u}) {
      const Counted counted = count(mesh, run_triangles);
      check(counted, run_triangles);
      for (const CellNode& node : counted.nodes) {
        EXPECT_GE(node.count, run_triangles / 8);
      }
    }
  }
}

TEST(CellGrid, OutlierIsCutOffWhereNoPlaneAllowsMore) {
  Random random(3);
  Mesh mesh = tests::moved(tests::soup(random, 5000), {}, 1e-6F);
  mesh.push_back({Vec3f{1e6F, 0, 0}, {1e6F, 1, 0}, {1e6F, 0, 1}});
  const Counted counted = count(mesh, 1000);
  check(counted, 1000);
  ASSERT_EQ(counted.nodes.size(), 3u) << "the cluster is one cell, for a finer grid to cut";
  EXPECT_EQ(std::min(counted.nodes[1].count, counted.nodes[2].count), 1u);
}

TEST(CellGrid, FlatAndThinScenesAreCutAlongWhatTheyHave) {
  const Counted flat = count(tests::grid(100), 1000);
  check(flat, 1000);
  EXPECT_GT(flat.nodes.size(), 20u);
  const Counted line = count(tests::collinear(10000), 1000);
  check(line, 1000);
  EXPECT_GT(line.nodes.size(), 10u);
}

TEST(CellGrid, MiddlesInOnePlaceAreOneNode) {
  for (const Mesh& mesh : {tests::coincident(5000), tests::moved(tests::coincident(5000), {7, 8, 9}, 1e30F)}) {
    const Counted counted = count(mesh, 1000);
    EXPECT_EQ(counted.grid.cell_count(), 1u);
    ASSERT_EQ(counted.nodes.size(), 1u);
    EXPECT_EQ(counted.nodes[0].count, 5000u);
    EXPECT_TRUE(counted.nodes[0].is_leaf());
  }
}

TEST(CellGrid, GridWithoutTrianglesIsOneEmptyNode) {
  CellGrid grid({{0, 0, 0}, {1, 1, 1}}, 100);
  const std::vector<CellNode> nodes = grid.partition(10);
  ASSERT_EQ(nodes.size(), 1u);
  EXPECT_EQ(nodes[0].count, 0u);
  EXPECT_TRUE(grid.cells_of(nodes[0]).empty());
}

TEST(CellGrid, OrderOfTheTrianglesDoesNotMatter) {
  Random random(4);
  Mesh mesh = tests::soup(random, 10000);
  const Counted first = count(mesh, 500);
  for (std::size_t i = mesh.size(); i > 1; --i) {
    std::swap(mesh[i - 1], mesh[random.below(static_cast<std::uint32_t>(i))]);
  }
  const Counted second = count(mesh, 500);
  ASSERT_EQ(first.nodes.size(), second.nodes.size());
  for (std::size_t i = 0; i < first.nodes.size(); ++i) {
    EXPECT_EQ(first.nodes[i].count, second.nodes[i].count);
    EXPECT_EQ(first.nodes[i].box, second.nodes[i].box);
    EXPECT_EQ(first.nodes[i].left, second.nodes[i].left);
  }
}

TEST(CellGrid, CellsAreNoMoreThanClaimedWhateverTheShape) {
  Random random(5);
  for (const std::uint64_t triangles :
       {std::uint64_t{1}, std::uint64_t{100}, std::uint64_t{100000}, std::uint64_t{1} << 22, std::uint64_t{1} << 40}) {
    const std::uint64_t most = std::clamp<std::uint64_t>(triangles / 16, 1, std::uint64_t{CellGrid::kMostCells});
    for (int i = 0; i < 50; ++i) {
      Aabb middles;
      middles.grow(Vec3f{});
      middles.grow(Vec3f{std::pow(10.0F, random.uniform(-37, 37)), std::pow(10.0F, random.uniform(-3, 3)),
                         random.below(2) == 0 ? 0 : std::pow(10.0F, random.uniform(-3, 3))});
      const CellGrid grid(middles, triangles);
      EXPECT_LE(grid.cell_count(), most);
      EXPECT_LT(grid.cell_of(middles.lower), grid.cell_count());
      EXPECT_LT(grid.cell_of(middles.upper), grid.cell_count());
      EXPECT_LT(grid.cell_of({-1e38F, 1e38F, 0}), grid.cell_count()) << "what lies outside belongs to the nearest cell";
    }
  }
  const CellGrid cube({{0, 0, 0}, {1, 1, 1}}, std::uint64_t{1} << 40);
  EXPECT_GT(cube.cell_count(), CellGrid::kMostCells / 2) << "and hardly fewer";
}

}  // namespace
}  // namespace raymill::storage
