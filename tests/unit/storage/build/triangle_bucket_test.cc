#include "storage/build/triangle_bucket.h"

#include <gtest/gtest.h>

#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::TempFolder;

std::vector<Triangle> soup(std::size_t count) {
  Random random(count);
  return tests::triangles_of({tests::soup(random, count)});
}

void expect_same(std::span<const Triangle> got, std::span<const Triangle> expected) {
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    ASSERT_EQ(got[i].primitive_id, expected[i].primitive_id) << i;
    ASSERT_EQ(got[i].v, expected[i].v) << i;
  }
}

TriangleBucket bucket_of(BlockStore& store, std::span<const Triangle> triangles) {
  BucketWriter writer(store);
  for (const Triangle& t : triangles) {
    EXPECT_TRUE(writer.add(t).ok());
  }
  auto bucket = writer.take();
  EXPECT_TRUE(bucket) << bucket.status().message();
  return *bucket;
}

std::vector<Triangle> loaded(BlockStore& store, const TriangleBucket& bucket) {
  std::vector<Triangle> triangles(3);  // what stood there before goes
  const Status status = load(store, bucket, triangles);
  EXPECT_TRUE(status.ok()) << status.message();
  return triangles;
}

// In memory, and in the file.
class Bucket : public testing::TestWithParam<std::uint64_t> {
 protected:
  TempFolder folder_;
  Ledger ledger_{GetParam()};
  BlockStore store_{ledger_, folder_.path()};
};
INSTANTIATE_TEST_SUITE_P(Budgets, Bucket, testing::Values(0, gibibytes(1)));

TEST_P(Bucket, OrderIsKeptAcrossBlocks) {
  for (const std::size_t count : {std::size_t{0}, std::size_t{1}, kBlockTriangles - 1, kBlockTriangles,
                                  kBlockTriangles + 1, 3 * kBlockTriangles + 7}) {
    const std::vector<Triangle> triangles = soup(count);
    const TriangleBucket bucket = bucket_of(store_, triangles);
    EXPECT_EQ(bucket.count, count);
    EXPECT_EQ(bucket.blocks.size(), (count + kBlockTriangles - 1) / kBlockTriangles);
    expect_same(loaded(store_, bucket), triangles);
  }
}

TEST_P(Bucket, BoxesAreThoseOfTheTriangles) {
  const std::vector<Triangle> triangles = soup(2 * kBlockTriangles);
  const TriangleBucket bucket = bucket_of(store_, triangles);
  Aabb box, middles;
  for (const Triangle& t : triangles) {
    box.grow(bounds(t));
    middles.grow(middle(bounds(t)));
  }
  EXPECT_EQ(bucket.box, box);
  EXPECT_EQ(bucket.middles, middles);
}

TEST_P(Bucket, WriterIsEmptyAfterItsBucketIsTaken) {
  const std::vector<Triangle> first = soup(kBlockTriangles + 5), second = soup(3);
  BucketWriter writer(store_);
  std::vector<TriangleBucket> buckets;
  for (const auto* triangles : {&first, &second}) {
    for (const Triangle& t : *triangles) {
      ASSERT_TRUE(writer.add(t).ok());
    }
    buckets.push_back(*writer.take());
  }
  expect_same(loaded(store_, buckets[1]), second);
  expect_same(loaded(store_, buckets[0]), first);
  const auto none = writer.take();
  ASSERT_TRUE(none);
  EXPECT_EQ(none->count, 0u);
  EXPECT_TRUE(none->blocks.empty());
  EXPECT_TRUE(none->box.empty());
}

TEST_P(Bucket, BlocksAreFreedByLoading) {
  const TriangleBucket bucket = bucket_of(store_, soup(4 * kBlockTriangles));
  const TriangleBucket other = bucket_of(store_, soup(4 * kBlockTriangles));
  EXPECT_EQ(store_.file_bytes(), GetParam() == 0 ? 8 * kBlockBytes : 0);
  loaded(store_, bucket);
  loaded(store_, other);
  bucket_of(store_, soup(8 * kBlockTriangles));
  EXPECT_EQ(store_.file_bytes(), GetParam() == 0 ? 8 * kBlockBytes : 0);
}

TEST(TriangleBucket, MiddlesOfTheLargestTrianglesAreFinite) {
  TriangleBucket bucket;
  constexpr float kMost = std::numeric_limits<float>::max();
  bucket.note(bounds({{Vec3f{kMost, kMost, kMost}, {kMost, 0, kMost}, {kMost, kMost, -kMost}}, 0, 0}));
  EXPECT_EQ(bucket.middles.lower, (Vec3f{kMost, kMost / 2, 0}));
}

}  // namespace
}  // namespace raymill::storage
