// The partition: which triangles come into which run, for scenes that are made to be hard to cut.
#include "storage/build/partition.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>

#include "tests/support/effort.h"
#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::Scene;
using tests::TempFolder;

using Id = std::pair<std::uint32_t, std::uint32_t>;

Id id_of(const Triangle& t) { return {t.geometry_id, t.primitive_id}; }

struct Setup {
  std::uint64_t run_triangles = 64;
  std::uint32_t most_open_buckets = 64;
  unsigned threads = 1;
  std::uint64_t memory = gibibytes(1);
  std::string positions = "float32";
  std::function<Status(std::uint64_t)> progress = {};
};

// A partition and the triangles of its runs.
struct Cut {
  Status status;
  Partition partition;
  std::vector<std::vector<Triangle>> runs;
  double max_displacement = 0;
};

Cut cut(const std::vector<Triangle>& triangles, const Setup& setup = {}) {
  const TempFolder folder;
  Ledger ledger(setup.memory);
  BlockStore store(ledger, folder.path());
  BucketWriter writer(store);
  for (const Triangle& t : triangles) {
    EXPECT_TRUE(writer.add(t).ok());
  }
  TriangleBucket all = *writer.take();
  Lattice lattice(*parse_positions(setup.positions), all.box);
  Cut result;
  auto partition = partition_triangles(store, std::move(all), lattice,
                                       {setup.run_triangles, setup.most_open_buckets, setup.threads, setup.progress});
  result.status = partition.status();
  if (!partition) {
    return result;
  }
  result.partition = std::move(*partition);
  result.max_displacement = lattice.max_displacement();
  for (const TriangleBucket& run : result.partition.runs) {
    EXPECT_TRUE(load(store, run, result.runs.emplace_back()).ok());
  }
  return result;
}

// What must hold for any scene; `expected`: the triangles that should be in the runs, in the input's order.
void check(const Cut& cut, const std::vector<Triangle>& expected, std::uint64_t run_triangles) {
  ASSERT_TRUE(cut.status.ok()) << cut.status.message();
  std::map<Id, std::size_t> place;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    place.emplace(id_of(expected[i]), i);
  }
  std::vector<int> found(expected.size());
  for (std::size_t run = 0; run < cut.runs.size(); ++run) {
    EXPECT_FALSE(cut.runs[run].empty());
    EXPECT_LE(cut.runs[run].size(), run_triangles);
    Aabb box;
    std::size_t last = 0;
    for (const Triangle& t : cut.runs[run]) {
      const auto at = place.find(id_of(t));
      ASSERT_NE(at, place.end());
      EXPECT_EQ(t.v, expected[at->second].v);
      EXPECT_GE(at->second, last) << "a run keeps the input's order";
      last = at->second;
      ++found[at->second];
      box.grow(bounds(t));
    }
    EXPECT_EQ(cut.partition.runs[run].count, cut.runs[run].size());
    EXPECT_EQ(cut.partition.runs[run].box, box);
  }
  EXPECT_TRUE(std::all_of(found.begin(), found.end(), [](int n) { return n == 1; })) << "each is in one run";

  const auto& nodes = cut.partition.nodes;
  ASSERT_EQ(nodes.size(), cut.runs.size() * 2 - 1);
  EXPECT_EQ(nodes[0].run_count, cut.runs.size());
  EXPECT_EQ(nodes[0].count, expected.size());
  for (std::uint32_t i = 0; i < nodes.size(); ++i) {
    const PartitionNode& node = nodes[i];
    if (node.is_leaf()) {
      EXPECT_EQ(node.run_count, 1u);
      EXPECT_EQ(node.count, cut.partition.runs[node.first_run].count);
      EXPECT_EQ(node.box, cut.partition.runs[node.first_run].box);
      continue;
    }
    const PartitionNode& left = nodes[node.left];
    const PartitionNode& right = nodes[node.right];
    EXPECT_GT(node.left, i) << "parents stand first";
    EXPECT_GT(node.right, i);
    EXPECT_EQ(node.count, left.count + right.count);
    EXPECT_EQ(node.first_run, left.first_run);
    EXPECT_EQ(left.first_run + left.run_count, right.first_run) << "runs below a node follow each other";
    EXPECT_EQ(node.run_count, left.run_count + right.run_count);
    Aabb box = left.box;
    box.grow(right.box);
    EXPECT_EQ(node.box, box);
  }
}

void expect_same(const Cut& a, const Cut& b) {
  ASSERT_TRUE(a.status.ok() && b.status.ok());
  ASSERT_EQ(a.runs.size(), b.runs.size());
  for (std::size_t run = 0; run < a.runs.size(); ++run) {
    ASSERT_EQ(a.runs[run].size(), b.runs[run].size());
    for (std::size_t i = 0; i < a.runs[run].size(); ++i) {
      ASSERT_EQ(id_of(a.runs[run][i]), id_of(b.runs[run][i]));
      ASSERT_EQ(a.runs[run][i].v, b.runs[run][i].v);
    }
  }
  ASSERT_EQ(a.partition.nodes.size(), b.partition.nodes.size());
  for (std::size_t i = 0; i < a.partition.nodes.size(); ++i) {
    EXPECT_EQ(a.partition.nodes[i].left, b.partition.nodes[i].left);
    EXPECT_EQ(a.partition.nodes[i].right, b.partition.nodes[i].right);
  }
  EXPECT_EQ(a.partition.dropped_degenerate, b.partition.dropped_degenerate);
  EXPECT_EQ(a.max_displacement, b.max_displacement);
}

struct PartitionCase {
  const char* name;
  std::function<Scene()> make;
};

std::vector<PartitionCase> partition_cases() {
  const auto with = [](auto&& make) {
    return [make] {
      Random random(1);
      return make(random);
    };
  };
  return {
      {"one_triangle", with([](Random& r) { return Scene{tests::soup(r, 1)}; })},
      {"one_run", with([](Random& r) { return Scene{tests::soup(r, 64)}; })},
      {"one_more_than_a_run", with([](Random& r) { return Scene{tests::soup(r, 65)}; })},
      {"soups", with([](Random& r) {
         return Scene{tests::soup(r, 5000), tests::soup(r, 3000, 0.01F)};
       })},
      {"grid", [] { return Scene{tests::grid(60, 0.1F)}; }},
      {"flat_grid", [] { return Scene{tests::grid(60)}; }},
      {"needles", with([](Random& r) { return Scene{tests::needles(r, 4000)}; })},
      {"nested_shells", [] { return Scene{tests::nested_shells(4000)}; }},
      {"coincident", [] { return Scene{tests::coincident(4001)}; }},
      {"coincident_within_a_soup", with([](Random& r) {
         return Scene{tests::soup(r, 1000), tests::coincident(999)};
       })},
      {"on_a_line", [] { return Scene{tests::collinear(4000)}; }},
      {"cluster_with_one_far_away", with([](Random& r) {
         return Scene{tests::moved(tests::soup(r, 4000), {}, 1e-6F), tests::moved(tests::grid(1), {1e9F, 1e9F, 1e9F})};
       })},
      {"of_every_scale", with([](Random& r) {
         Scene scene;
         for (int e = -35; e <= 35; e += 5) {
           scene.push_back(tests::moved(tests::soup(r, 300), {}, std::pow(10.0F, float(e))));
         }
         return scene;
       })},
      // A chain of ever smaller clusters: each grid tells only the largest few apart.
      {"shrinking_clusters", with([](Random& r) {
         Scene scene;
         for (int e = 0; e < 30; ++e) {
           const float scale = std::ldexp(1.0F, -4 * e);
           scene.push_back(tests::moved(tests::soup(r, 100, 0.01F), {scale * 3, 0, 0}, scale));
         }
         return scene;
       })},
  };
}

class PartitionOf : public testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(Scenes, PartitionOf, testing::Range(std::size_t{0}, partition_cases().size()),
                         [](const auto& scene) { return partition_cases()[scene.param].name; });

TEST_P(PartitionOf, PutsEveryTriangleIntoOneRunWithinTheLimit) {
  const std::vector<Triangle> triangles = tests::triangles_of(partition_cases()[GetParam()].make());
  for (const std::uint64_t run_triangles : {16u, 64u, 500u, 1u << 18}) {
    SCOPED_TRACE("runs of " + std::to_string(run_triangles));
    check(cut(triangles, {.run_triangles = run_triangles}), triangles, run_triangles);
  }
}

TEST_P(PartitionOf, IsTheSameForAnyNumberOfOpenBucketsAnyThreadsAndAnyMemory) {
  const std::vector<Triangle> triangles = tests::triangles_of(partition_cases()[GetParam()].make());
  for (const std::string positions : {"float32", "lattice:8b"}) {
    const Cut first = cut(triangles, {.positions = positions});
    for (const std::uint32_t most_open_buckets : {2u, 3u, 7u, 4096u}) {
      for (const std::uint64_t memory : {std::uint64_t{0}, mebibytes(5), gibibytes(1)}) {
        for (const unsigned threads : {1u, 2u, 5u}) {
          const bool is_left_out = threads == 2 || most_open_buckets == 3 || (threads == 1) != (memory == mebibytes(5));
          if (tests::kSanitized && is_left_out) {
            continue;
          }
          SCOPED_TRACE(positions + ", " + std::to_string(most_open_buckets) + " buckets, " + std::to_string(threads) +
                       " threads");
          expect_same(first, cut(triangles, {.most_open_buckets = most_open_buckets,
                                             .threads = threads,
                                             .memory = memory,
                                             .positions = positions}));
        }
      }
    }
  }
}

TEST_P(PartitionOf, DropsAndCountsOnceWhatTheLatticeMakesDegenerate) {
  const std::vector<Triangle> triangles = tests::triangles_of(partition_cases()[GetParam()].make());
  for (const std::string positions : {"lattice:4b", "lattice:10b"}) {
    std::vector<Triangle> expected = triangles;
    const auto snapped = snap_to_lattice(*parse_positions(positions), expected);
    if (!snapped) {
      EXPECT_EQ(cut(triangles, {.positions = positions}).status.code(), snapped.status().code());
      continue;
    }
    for (const std::uint32_t most_open_buckets : {2u, 64u}) {
      const Cut got = cut(triangles, {.most_open_buckets = most_open_buckets, .positions = positions});
      ASSERT_TRUE(got.status.ok()) << got.status.message();
      EXPECT_EQ(got.partition.dropped_degenerate, snapped->dropped_degenerate);
      EXPECT_EQ(got.max_displacement, snapped->max_displacement);
      if (expected.empty()) {
        EXPECT_TRUE(got.runs.empty());
      } else {
        check(got, expected, 64);
      }
    }
  }
}

TEST(Partition, OfNothingIsEmpty) {
  const Cut none = cut({});
  ASSERT_TRUE(none.status.ok());
  EXPECT_TRUE(none.partition.nodes.empty());
  EXPECT_TRUE(none.partition.runs.empty());
}

TEST(Partition, OfNothingButWhatTheLatticeDropsIsEmpty) {
  Random random(1);
  auto triangles = tests::triangles_of({tests::moved(tests::soup(random, 1000), {}, 1e-6F)});
  const Cut none = cut(triangles, {.positions = "lattice:1"});
  ASSERT_TRUE(none.status.ok());
  EXPECT_EQ(none.partition.dropped_degenerate, 1000u);
  EXPECT_TRUE(none.partition.nodes.empty());
  EXPECT_TRUE(none.partition.runs.empty());
}

TEST(Partition, TriangleOutOfTheLatticesRangeIsRefused) {
  auto triangles = tests::triangles_of({tests::grid(10), tests::moved(tests::grid(1), {1e20F, 0, 0})});
  const Status status = cut(triangles, {.positions = "lattice:0.001"}).status;
  EXPECT_EQ(status.code(), ErrorCode::invalid_argument);
  EXPECT_NE(status.message().find("use a larger step"), std::string::npos) << status.message();
}

TEST(Partition, TrianglesThatNoPlaneTellsApartGoInEqualShares) {
  const Cut shares = cut(tests::triangles_of({tests::coincident(1000)}), {.run_triangles = 300});
  ASSERT_EQ(shares.runs.size(), 4u);
  for (const auto& run : shares.runs) {
    EXPECT_EQ(run.size(), 250u);
  }
}

TEST(Partition, ProgressRisesAndItsErrorEndsTheWork) {
  Random random(1);
  const auto triangles = tests::triangles_of({tests::soup(random, 20000)});
  std::vector<std::uint64_t> seen;
  const Cut whole = cut(triangles, {.progress = [&](std::uint64_t handled) {
                          seen.push_back(handled);
                          return Status();
                        }});
  ASSERT_TRUE(whole.status.ok());
  ASSERT_GT(seen.size(), 10u);
  EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
  EXPECT_GE(seen.back(), 2 * triangles.size()) << "counted and handed out";
  for (std::size_t stop_at = 1; stop_at <= seen.size(); stop_at += tests::kSanitized ? 97 : 29) {
    std::size_t calls = 0;
    const Status status =
        cut(triangles, {.progress =
                            [&](std::uint64_t) {
                              return ++calls == stop_at ? Status(ErrorCode::interrupted, "enough") : Status();
                            }})
            .status;
    EXPECT_EQ(status.code(), ErrorCode::interrupted);
    EXPECT_EQ(calls, stop_at) << "nothing goes on after it";
  }
}

TEST(Partition, FreesTheBlocksOfItsInput) {
  Random random(1);
  const auto triangles = tests::triangles_of({tests::soup(random, 20 * kBlockTriangles)});
  const TempFolder folder;
  Ledger ledger(0);
  BlockStore store(ledger, folder.path());
  BucketWriter writer(store);
  for (const Triangle& t : triangles) {
    ASSERT_TRUE(writer.add(t).ok());
  }
  Lattice lattice;
  const auto partition = partition_triangles(store, *writer.take(), lattice, {4 * kBlockTriangles, 2, 1, {}});
  ASSERT_TRUE(partition);
  for (const TriangleBucket& run : partition->runs) {
    std::vector<Triangle> loaded;
    ASSERT_TRUE(load(store, run, loaded).ok());
  }
  const std::uint64_t fullest = store.file_bytes();
  // While they are handed out, a triangle is in the input or in a bucket; each open one has a last block that is not
  // full, and so has each that waits.
  EXPECT_LE(fullest, (20 + partition->runs.size() + 2) * kBlockBytes);
  for (std::uint64_t i = 0; i < fullest / kBlockBytes; ++i) {
    ASSERT_TRUE(store.write({}));
  }
  EXPECT_EQ(store.file_bytes(), fullest) << "every block was given back";
}

}  // namespace
}  // namespace raymill::storage
