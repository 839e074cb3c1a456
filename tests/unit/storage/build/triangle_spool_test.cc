// TriangleSpool: with a thread of its own and without, the same bucket.
#include "storage/build/triangle_spool.h"

#include <gtest/gtest.h>

#include "tests/support/scenes.h"
#include "tests/support/temp_folder.h"

namespace raymill::storage {
namespace {

using tests::Random;
using tests::TempFolder;

std::vector<Triangle> numbered_soup(std::size_t count) {
  Random random(count);
  return tests::triangles_of({tests::soup(random, count)});
}

class Spool : public testing::TestWithParam<bool> {
 protected:
  // Adds the triangles in pieces of many sizes.
  static Status add(TriangleSpool& spool, std::span<const Triangle> triangles) {
    std::size_t piece = 1;
    while (!triangles.empty()) {
      const std::size_t taken = std::min(piece, triangles.size());
      RAYMILL_RETURN_IF_ERROR(spool.add(triangles.first(taken)));
      triangles = triangles.subspan(taken);
      piece = piece * 3 % 20011;
    }
    return {};
  }

  TempFolder folder_;
  Ledger ledger_{0};
  BlockStore store_{ledger_, folder_.path()};
  TriangleSpool spool_{store_, GetParam()};
};
INSTANTIATE_TEST_SUITE_P(OwnThread, Spool, testing::Bool());

TEST_P(Spool, TrianglesComeBackInTheirOrder) {
  for (const std::size_t count : {0u, 1u, 8192u, 8193u, 100000u}) {
    const std::vector<Triangle> triangles = numbered_soup(count);
    ASSERT_TRUE(add(spool_, triangles).ok());
    const auto bucket = spool_.take();
    ASSERT_TRUE(bucket) << bucket.status().message();
    EXPECT_EQ(bucket->count, count);
    Aabb box;
    for (const Triangle& t : triangles) {
      box.grow(bounds(t));
    }
    EXPECT_EQ(bucket->box, box);
    std::vector<Triangle> loaded;
    ASSERT_TRUE(load(store_, *bucket, loaded).ok());
    ASSERT_EQ(loaded.size(), count);
    for (std::size_t i = 0; i < count; ++i) {
      ASSERT_EQ(loaded[i].primitive_id, triangles[i].primitive_id);
      ASSERT_EQ(loaded[i].v, triangles[i].v);
    }
  }
}

TEST_P(Spool, DiskThatRefusesIsToldOfInTheEnd) {
  BlockStore nowhere(ledger_, folder_ / "none");
  TriangleSpool spool(nowhere, GetParam());
  Status status;
  for (int i = 0; i < 20 && status.ok(); ++i) {
    status = add(spool, numbered_soup(9000));
  }
  EXPECT_EQ(status.code(), ErrorCode::io);
  EXPECT_EQ(spool.take().status().code(), ErrorCode::io);
}

TEST_P(Spool, EndsWithoutBeingTaken) { ASSERT_TRUE(add(spool_, numbered_soup(100000)).ok()); }

}  // namespace
}  // namespace raymill::storage
