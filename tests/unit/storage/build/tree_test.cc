// The binary tree and its collapse: what must hold for any scene, over scenes that are made to break trees.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <set>

#include "storage/build/binary_tree.h"
#include "storage/build/collapse.h"
#include "tests/support/trees.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::Scene;

struct TreeCase {
  const char* name;
  std::function<Scene()> make;
};

std::vector<TreeCase> tree_cases() {
  return {
      {"one_triangle", [] { return Scene{tests::grid(1, 0)}; }},
      {"nine_triangles",
       [] {
         Random random(1);
         return Scene{tests::soup(random, 9)};
       }},
      {"soup",
       [] {
         Random random(2);
         return Scene{tests::soup(random, 5000), tests::soup(random, 700, 0.01F)};
       }},
      {"grid", [] { return Scene{tests::grid(60, 0.1F)}; }},
      {"needles",
       [] {
         Random random(3);
         return Scene{tests::needles(random, 3000)};
       }},
      {"ten_thousand_nested_shells", [] { return Scene{tests::nested_shells(10000)}; }},
      {"all_coincident", [] { return Scene{tests::coincident(10000)}; }},
      {"centroids_on_a_line", [] { return Scene{tests::collinear(10000)}; }},
      {"tiny",
       [] {
         Random random(4);
         return Scene{tests::moved(tests::soup(random, 500), {}, 1e-36F)};
       }},
      {"huge",
       [] {
         Random random(5);
         return Scene{tests::moved(tests::soup(random, 500), {}, 1e36F)};
       }},
      {"of_every_scale",
       [] {
         Random random(6);
         Scene scene;
         for (int e = -30; e <= 30; e += 5) {
           scene.push_back(tests::moved(tests::soup(random, 100), {}, std::pow(10.0F, float(e))));
         }
         return scene;
       }},
  };
}

using Id = std::pair<std::uint32_t, std::uint32_t>;

// Walks the tree and proves its invariants; `why` names the case.
void check(const WideTree& tree, const std::vector<Triangle>& input, const std::string& why) {
  std::multiset<Id> expected, found;
  for (const Triangle& t : input) {
    expected.emplace(t.geometry_id, t.primitive_id);
  }
  ASSERT_EQ(tree.triangles.size(), input.size()) << why;
  ASSERT_LE(tree.levels, max_levels(tree.width)) << why;
  std::vector<int> visits(tree.nodes.size());
  std::vector<bool> in_leaf(tree.triangles.size());
  unsigned levels = 0;
  // The box of everything below a node, by recursion that is as deep as the tree.
  const std::function<Aabb(std::uint32_t)> walk = [&](std::uint32_t index) {
    const WideNode& node = tree.nodes[index];
    ++visits[index];
    levels = std::max(levels, node.level + 1u);
    Aabb all;
    EXPECT_NE(node.valid, 0) << why;
    for (unsigned slot = 0; slot < tree.width; ++slot) {
      if (!node.has(slot)) {
        continue;
      }
      Aabb below;
      if (node.is_leaf(slot)) {
        EXPECT_LE(node.count[slot], kMaxLeafTriangles) << why;
        for (std::uint32_t t = node.child[slot]; t < node.child[slot] + node.count[slot]; ++t) {
          EXPECT_FALSE(in_leaf[t]) << why << ": triangle " << t << " stands in two leaves";
          in_leaf[t] = true;
          below.grow(bounds(tree.triangles[t]));
          found.emplace(tree.triangles[t].geometry_id, tree.triangles[t].primitive_id);
        }
      } else {
        const std::uint32_t child = node.child[slot];
        EXPECT_GT(child, index) << why << ": nodes stand depth first";
        EXPECT_EQ(tree.nodes[child].parent, index) << why;
        EXPECT_EQ(tree.nodes[child].level, node.level + 1) << why;
        below = walk(child);
      }
      EXPECT_EQ(node.boxes[slot], below) << why << ": box of slot " << slot << " of node " << index;
      all.grow(below);
    }
    EXPECT_EQ(node.valid >> tree.width, 0) << why;
    return all;
  };
  EXPECT_EQ(walk(0), tree.bounds) << why;
  EXPECT_EQ(levels, tree.levels) << why;
  EXPECT_TRUE(std::all_of(visits.begin(), visits.end(), [](int n) { return n == 1; })) << why;
  EXPECT_EQ(found, expected) << why;
}

class TreeOf : public testing::TestWithParam<std::size_t> {};

TEST_P(TreeOf, HoldsEveryTriangleOnceInExactBoxesWithinTheBitstack) {
  const TreeCase scene_case = tree_cases()[GetParam()];
  const Scene scene = scene_case.make();
  for (const unsigned width : {4u, 8u}) {
    const WideTree tree = tests::build_tree(scene, width);
    check(tree, tests::triangles_of(scene), std::string(scene_case.name) + ", width " + std::to_string(width));
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, TreeOf, testing::Range(std::size_t{0}, tree_cases().size()),
                         [](const auto& param) { return std::string(tree_cases()[param.param].name); });

TEST(BinaryTreeBuilder, GivesTheSameTreeWhateverItBuiltBefore) {
  Random random(1);
  const auto device = EmbreeDevice::create();
  ASSERT_TRUE(device);
  BinaryTreeBuilder used(*device);
  BinaryTree tree;
  for (const std::size_t count : {3000u, 1u, 5000u, 100u}) {
    const std::vector<Triangle> triangles = tests::triangles_of({tests::soup(random, count)});
    std::vector<Triangle> sorted = triangles, expected_sorted = triangles;
    BinaryTree expected;
    ASSERT_TRUE(used.build(sorted, tree).ok());
    ASSERT_TRUE(BinaryTreeBuilder(*device).build(expected_sorted, expected).ok());
    ASSERT_EQ(tree.nodes.size(), expected.nodes.size());
    for (std::size_t i = 0; i < tree.nodes.size(); ++i) {
      EXPECT_EQ(tree.nodes[i].box, expected.nodes[i].box);
      EXPECT_EQ(tree.nodes[i].left, expected.nodes[i].left);
      EXPECT_EQ(tree.nodes[i].count, expected.nodes[i].count);
    }
    for (std::size_t i = 0; i < count; ++i) {
      EXPECT_EQ(sorted[i].primitive_id, expected_sorted[i].primitive_id);
    }
  }
}

TEST(Collapse, AnyLevelLimitThatABalancedTreeMeetsIsMet) {
  const Scene scene{tests::nested_shells(2000)};
  std::vector<Triangle> triangles = tests::triangles_of(scene);
  const auto device = EmbreeDevice::create();
  ASSERT_TRUE(device);
  BinaryTree binary;
  ASSERT_TRUE(BinaryTreeBuilder(*device).build(triangles, binary).ok());
  for (const unsigned width : {4u, 8u}) {
    for (unsigned limit = balanced_levels(2000, width); limit <= max_levels(width); ++limit) {
      const WideTree tree = collapse(binary, triangles, width, {0, limit});
      EXPECT_LE(tree.levels, limit);
      check(tree, tests::triangles_of(scene), "limit " + std::to_string(limit));
    }
  }
}

TEST(Collapse, BalancedLevelsAreTheLeastThatHold) {
  EXPECT_EQ(balanced_levels(1, 8), 1u);
  EXPECT_EQ(balanced_levels(64, 8), 1u);
  EXPECT_EQ(balanced_levels(65, 8), 2u);
  EXPECT_EQ(balanced_levels(512, 8), 2u);
  EXPECT_EQ(balanced_levels(513, 8), 3u);
  EXPECT_EQ(balanced_levels(32, 4), 1u);
  EXPECT_EQ(balanced_levels(33, 4), 2u);
  EXPECT_LE(balanced_levels(std::uint64_t{1} << 32, 8), max_levels(8));
  EXPECT_LE(balanced_levels(std::uint64_t{1} << 32, 4), max_levels(4));
}

TEST(Collapse, FlatSceneCostsNoMoreThanItsSlabs) {
  const WideTree tree = tests::build_tree({tests::grid(64, 0)}, 8);
  EXPECT_GT(tree.sah_cost(), 1);
  EXPECT_LT(tree.sah_cost(), 64) << "a regular grid of 8192 triangles";
}

}  // namespace
}  // namespace raymill::storage
