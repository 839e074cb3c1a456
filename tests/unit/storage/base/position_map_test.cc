#include "storage/base/position_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <tuple>
#include <vector>

#include "tests/support/random.h"

namespace raymill::storage {
namespace {

TEST(PositionMap, NumbersInTheOrderOfFirstUse) {
  PositionMap map;
  EXPECT_EQ(map.insert({1, 2, 3}), 0u);
  EXPECT_EQ(map.insert({4, 5, 6}), 1u);
  EXPECT_EQ(map.insert({1, 2, 3}), 0u);
  EXPECT_EQ(map.size(), 2u);
  EXPECT_EQ(map.positions()[1], (Vec3f{4, 5, 6}));
}

TEST(PositionMap, ZerosOfBothSignsAreTwoPositions) {
  PositionMap map;
  EXPECT_NE(map.insert({0.0F, 0, 0}), map.insert({-0.0F, 0, 0}));
}

TEST(PositionMap, ClearForgetsEverything) {
  PositionMap map(4);
  map.insert({1, 0, 0});
  map.insert({2, 0, 0});
  map.clear();
  EXPECT_EQ(map.size(), 0u);
  EXPECT_EQ(map.insert({2, 0, 0}), 0u);
}

TEST(PositionMap, RollbackTakesBackTheNewestOnly) {
  PositionMap map(2);  // small: slots are probed and the table grows
  for (int i = 0; i < 100; ++i) {
    map.insert({float(i), 0, 0});
  }
  map.rollback(40);
  EXPECT_EQ(map.size(), 40u);
  for (int i = 0; i < 40; ++i) {
    EXPECT_EQ(map.insert({float(i), 0, 0}), std::uint32_t(i));
  }
  EXPECT_EQ(map.insert({77, 0, 0}), 40u);
}

// Against a map of the standard library, over random insertions, rollbacks and clears.
TEST(PositionMap, AgreesWithAPlainMapOverRandomHistories) {
  using Key = std::tuple<float, float, float>;
  tests::Random random(5);
  for (int round = 0; round < 20; ++round) {
    PositionMap map(1 + random.below(8));
    std::vector<Key> kept;
    for (int step = 0; step < 2000; ++step) {
      const std::uint32_t what = random.below(100);
      if (what == 0) {
        map.clear();
        kept.clear();
      } else if (what < 4 && !kept.empty()) {
        const std::size_t size = random.below(static_cast<std::uint32_t>(kept.size()) + 1);
        map.rollback(size);
        kept.resize(size);
      } else {
        const Key key(float(random.below(12)), float(random.below(6)), float(random.below(4)));
        const auto found = std::find(kept.begin(), kept.end(), key);
        const auto expected = static_cast<std::uint32_t>(found - kept.begin());
        if (found == kept.end()) {
          kept.push_back(key);
        }
        ASSERT_EQ(map.insert({std::get<0>(key), std::get<1>(key), std::get<2>(key)}), expected)
            << "round " << round << ", step " << step;
      }
      ASSERT_EQ(map.size(), kept.size());
    }
  }
}

}  // namespace
}  // namespace raymill::storage
