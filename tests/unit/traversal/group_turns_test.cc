#include "traversal/group_turns.h"

#include <gtest/gtest.h>

#include <numeric>
#include <vector>

#include "tests/support/random.h"

namespace raymill::traversal {
namespace {

constexpr std::uint32_t kTurnPages = 40, kGroupPages = 4;

class GroupTurnsTest : public testing::Test {
 protected:
  GroupTurns make(ReadOrder order) {
    return GroupTurns(
        {kTurnPages, kGroupPages, order, [](std::uint32_t page) { return page < 20 ? 1000U : 4000U; }},
        {[this](std::uint32_t group) { return disk_[group]; }, [this](std::uint32_t page) { return wanted_[page]; }});
  }
  // Reads the next page; all its rays are gone then.
  std::uint32_t read(GroupTurns& turns) {
    const auto page = turns.next_page();
    if (!page) {
      return kTurnPages;
    }
    EXPECT_GT(wanted_[*page], 0u);
    wanted_[*page] = 0;
    return *page;
  }
  std::vector<std::uint32_t> wanted_ = std::vector<std::uint32_t>(kTurnPages);
  std::vector<std::uint64_t> disk_ = std::vector<std::uint64_t>(kTurnPages / kGroupPages);
};

TEST_F(GroupTurnsTest, FullestGroupIsReadInTheFilesOrder) {
  GroupTurns turns = make(ReadOrder::most_rays);
  wanted_[3] = 100;
  wanted_[9] = 70;
  wanted_[10] = 80;
  wanted_[8] = 60;
  EXPECT_EQ(read(turns), 8u);
  EXPECT_EQ(turns.active(), 2u);
  EXPECT_EQ(read(turns), 9u);
  EXPECT_EQ(read(turns), 10u);
  EXPECT_EQ(read(turns), 3u);
  EXPECT_EQ(read(turns), kTurnPages);
}

TEST_F(GroupTurnsTest, PageThatIsWantedAgainInTheTurnIsReadAgain) {
  GroupTurns turns = make(ReadOrder::most_rays);
  wanted_[0] = 50;
  wanted_[1] = 60;
  wanted_[20] = 100;
  EXPECT_EQ(read(turns), 0u);
  wanted_[0] = 20;
  EXPECT_EQ(read(turns), 1u);
  EXPECT_EQ(read(turns), 0u);
  EXPECT_EQ(read(turns), 20u);
}

TEST_F(GroupTurnsTest, LonelyPageIsLeftForALaterTurn) {
  GroupTurns turns = make(ReadOrder::most_rays);
  wanted_[0] = 1;
  wanted_[1] = 200;
  wanted_[30] = 100;
  EXPECT_EQ(read(turns), 1u);
  EXPECT_EQ(read(turns), 30u);
  EXPECT_EQ(read(turns), 0u);
}

TEST_F(GroupTurnsTest, ScoreCountsWhatAReadCosts) {
  wanted_[0] = 50;
  wanted_[20] = 100;
  GroupTurns most = make(ReadOrder::most_rays);
  EXPECT_EQ(*most.next_page(), 20u);
  GroupTurns score = make(ReadOrder::score);
  EXPECT_EQ(*score.next_page(), 0u) << "half of the rays for a quarter of the bytes";
}

TEST_F(GroupTurnsTest, SweepGoesRound) {
  GroupTurns turns = make(ReadOrder::sweep);
  wanted_[30] = 1;
  EXPECT_EQ(read(turns), 30u);
  wanted_[2] = 5;
  wanted_[39] = 1;
  EXPECT_EQ(read(turns), 39u);
  EXPECT_EQ(read(turns), 2u);
}

TEST_F(GroupTurnsTest, RaysOnDiskAreWaitedForUntilNoneCanCome) {
  GroupTurns turns = make(ReadOrder::most_rays);
  disk_[5] = 1000;
  wanted_[0] = 10;
  turns.look();
  EXPECT_EQ(turns.active(), 5u);
  EXPECT_EQ(turns.next_page(), std::nullopt);
  wanted_[21] = 3;
  EXPECT_EQ(turns.next_page(), std::nullopt) << "a quarter of the average is 62";
  turns.read_everything();
  EXPECT_EQ(read(turns), 21u);
  disk_[5] = 0;
  EXPECT_EQ(read(turns), 0u);
}

// However many rays come to the other groups, each group is served within kAgeTurns turns for each group.
TEST_F(GroupTurnsTest, NoGroupIsForgotten) {
  for (const ReadOrder order : {ReadOrder::score, ReadOrder::most_rays, ReadOrder::fifo, ReadOrder::sweep}) {
    GroupTurns turns = make(order);
    std::fill(wanted_.begin(), wanted_.end(), 0);
    wanted_[38] = 1;
    unsigned reads = 0;
    for (; wanted_[38] > 0; ++reads) {
      wanted_[reads % 20] += 1000;
      (void)read(turns);
      ASSERT_LT(reads, GroupTurns::kAgeTurns * (kTurnPages / kGroupPages) * kGroupPages) << to_string(order);
    }
  }
}

TEST_F(GroupTurnsTest, EverythingIsReadInTheEnd) {
  tests::Random random(2);
  for (const ReadOrder order : {ReadOrder::score, ReadOrder::most_rays, ReadOrder::fifo, ReadOrder::sweep}) {
    GroupTurns turns = make(order);
    for (int step = 0; step < 2000; ++step) {
      wanted_[random.below(kTurnPages)] += random.below(random.below(9) == 0 ? 1000 : 3);
      if (random.below(2) == 0) {
        (void)read(turns);
      }
    }
    for (int step = 0; step < 1000; ++step) {
      (void)read(turns);
    }
    EXPECT_EQ(std::accumulate(wanted_.begin(), wanted_.end(), 0u), 0u) << to_string(order);
  }
}

}  // namespace
}  // namespace raymill::traversal
