#include "storage/build/top_tree.h"

#include <gtest/gtest.h>

#include <functional>

#include "tests/support/effort.h"
#include "tests/support/random.h"

namespace raymill::storage {
namespace {

using tests::Random;

enum class Shape { balanced, chain, random };

// A partition over runs of so many triangles each: boxes in a row, the tree of the shape asked for.
Partition partition_over(std::size_t runs, std::uint64_t run_triangles, Shape shape) {
  Partition partition;
  for (std::size_t i = 0; i < runs; ++i) {
    TriangleBucket& run = partition.runs.emplace_back();
    run.count = run_triangles;
    run.box.grow(Vec3f{float(i), 0, 0});
    run.box.grow(Vec3f{float(i) + 1, 1 + float(i % 3), 1});
  }
  Random random(runs);
  const std::function<std::uint32_t(std::size_t, std::size_t)> add = [&](std::size_t begin, std::size_t end) {
    const auto index = static_cast<std::uint32_t>(partition.nodes.size());
    PartitionNode node;
    node.first_run = static_cast<std::uint32_t>(begin);
    node.run_count = static_cast<std::uint32_t>(end - begin);
    node.count = node.run_count * run_triangles;
    for (std::size_t i = begin; i < end; ++i) {
      node.box.grow(partition.runs[i].box);
    }
    partition.nodes.push_back(node);
    if (end - begin > 1) {
      const std::size_t middle = shape == Shape::chain      ? begin + 1
                                 : shape == Shape::balanced ? (begin + end) / 2
                                                            : begin + 1 + random.below(node.run_count - 1);
      const std::uint32_t left = add(begin, middle), right = add(middle, end);
      partition.nodes[index].left = left;
      partition.nodes[index].right = right;
    }
    return index;
  };
  add(0, runs);
  return partition;
}

void check(const Partition& partition, unsigned width) {
  const TopTree built = build_top_tree(partition, width, {0, max_levels(width)});
  const WideTree& tree = built.tree;
  EXPECT_EQ(tree.width, width);
  EXPECT_TRUE(tree.triangles.empty());
  std::vector<int> hangs(partition.runs.size());
  std::vector<int> visits(tree.nodes.size());
  const std::function<Aabb(std::uint32_t)> walk = [&](std::uint32_t index) {
    const WideNode& node = tree.nodes[index];
    ++visits[index];
    Aabb all;
    EXPECT_GE(node.valid & (node.valid - 1), 1) << "a node has two children or more";
    for (unsigned slot = 0; slot < width; ++slot) {
      if (!node.has(slot)) {
        continue;
      }
      EXPECT_FALSE(node.is_leaf(slot));
      Aabb below;
      if (node.is_outer(slot)) {
        const std::uint32_t run = node.child[slot];
        ++hangs[run];
        below = partition.runs[run].box;
        EXPECT_EQ(built.places[run].parent, index);
        EXPECT_EQ(built.places[run].levels.first, node.level + 1u);
      } else {
        const std::uint32_t child = node.child[slot];
        EXPECT_GT(child, index) << "nodes stand depth first";
        EXPECT_EQ(tree.nodes[child].parent, index);
        EXPECT_EQ(tree.nodes[child].level, node.level + 1);
        below = walk(child);
      }
      EXPECT_EQ(node.boxes[slot], below);
      all.grow(below);
    }
    return all;
  };
  EXPECT_EQ(walk(0), partition.nodes[0].box);
  EXPECT_EQ(tree.bounds, partition.nodes[0].box);
  EXPECT_TRUE(std::all_of(hangs.begin(), hangs.end(), [](int n) { return n == 1; })) << "each run hangs in it once";
  EXPECT_TRUE(std::all_of(visits.begin(), visits.end(), [](int n) { return n == 1; }));
  ASSERT_EQ(built.places.size(), partition.runs.size());
  for (std::size_t run = 0; run < partition.runs.size(); ++run) {
    const LevelRange& levels = built.places[run].levels;
    EXPECT_LE(levels.limit, max_levels(width)) << "the bitstack holds all levels";
    EXPECT_LE(levels.first + balanced_levels(partition.runs[run].count, width), levels.limit)
        << "there is room for a balanced tree";
  }
}

TEST(TopTree, EveryRunHangsInItOnceWithRoomForItsTree) {
  for (const unsigned width : {4u, 8u}) {
    for (const Shape shape : {Shape::balanced, Shape::chain, Shape::random}) {
      for (const std::size_t runs : {2u, 3u, 8u, 9u, 100u, tests::kSanitized ? 600u : 5000u}) {
        for (const std::uint64_t run_triangles : {1u, 64u, 1u << 18}) {
          SCOPED_TRACE("width " + std::to_string(width) + ", " + std::to_string(runs) + " runs of " +
                       std::to_string(run_triangles));
          check(partition_over(runs, run_triangles, shape), width);
        }
      }
    }
  }
}

TEST(TopTree, OfOneRunHasNoNodes) {
  for (const unsigned width : {4u, 8u}) {
    const TopTree built = build_top_tree(partition_over(1, 1000, Shape::balanced), width, {3, max_levels(width)});
    EXPECT_TRUE(built.tree.nodes.empty());
    ASSERT_EQ(built.places.size(), 1u);
    EXPECT_EQ(built.places[0].levels.first, 3u);
    EXPECT_EQ(built.places[0].levels.limit, max_levels(width));
  }
}

TEST(TopTree, LeastLevelsAreThoseOfBalancedTrees) {
  // 8^14 leaves of 8 triangles and a level for the runs.
  const std::uint64_t many = std::uint64_t{1} << 45;
  Partition partition = partition_over(8, many, Shape::balanced);
  EXPECT_EQ(least_levels(partition, 8), 15u);
  EXPECT_EQ(least_levels(partition_over(8, many << 4, Shape::balanced), 8), 17u) << "more than the bitstack holds";
  partition.first_instances = 7;
  EXPECT_EQ(least_levels(partition, 8), 16u) << "a leaf holds one instance";
}

TEST(TopTree, TrianglesAndInstancesHangUnderOneRoot) {
  const Partition both = join(partition_over(5, 100, Shape::random), partition_over(3, 40, Shape::chain));
  ASSERT_EQ(both.runs.size(), 8u);
  EXPECT_FALSE(both.holds_instances(4));
  EXPECT_TRUE(both.holds_instances(5));
  EXPECT_EQ(both.nodes[0].count, 5u * 100 + 3 * 40);
  check(both, 8);
  EXPECT_TRUE(join(partition_over(1, 7, Shape::balanced), {}).runs.size() == 1u);
  EXPECT_TRUE(join({}, partition_over(1, 7, Shape::balanced)).holds_instances(0));
}

}  // namespace
}  // namespace raymill::storage
