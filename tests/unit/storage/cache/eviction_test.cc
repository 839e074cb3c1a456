#include "storage/cache/eviction.h"

#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "storage/cache/demand_eviction.h"

namespace raymill::storage {
namespace {

class EvictionTest : public testing::Test {
 protected:
  explicit EvictionTest(std::uint32_t frames = 4) : waiting_(frames), future_(frames), touched_(frames) {
    for (std::uint32_t frame = 0; frame < frames; ++frame) {
      pages_.push_back(PageId{frame});
    }
  }
  std::optional<std::uint32_t> choose(Eviction& eviction) {
    return eviction.choose(pages_, {waiting_, future_}, touched_.data());
  }

  std::vector<PageId> pages_;
  std::vector<std::uint32_t> waiting_;
  std::vector<std::atomic<std::int32_t>> future_;
  std::vector<std::atomic<std::uint8_t>> touched_;
};

TEST_F(EvictionTest, NamesAreReadAndOthersRefused) {
  for (const EvictionKind kind : {EvictionKind::clock, EvictionKind::demand}) {
    EXPECT_EQ(*parse_eviction(std::string(to_string(kind))), kind);
  }
  EXPECT_EQ(parse_eviction("lru").status().code(), ErrorCode::invalid_argument);
}

TEST_F(EvictionTest, DemandGivesUpThePageThatFewestRaysComeTo) {
  const auto eviction = make_eviction(EvictionKind::demand);
  future_[0] = 3, future_[1] = 2, future_[2] = 1, future_[3] = 2;
  EXPECT_EQ(choose(*eviction), 2u);
  waiting_[2] = 1;
  future_[3] = 1;
  EXPECT_EQ(choose(*eviction), 3u);
}

TEST_F(EvictionTest, DemandSparesPagesEnteredLatelyAmongEquals) {
  const auto eviction = make_eviction(EvictionKind::demand);
  touched_[0] = touched_[1] = touched_[3] = 1;
  EXPECT_EQ(choose(*eviction), 2u);
}

TEST_F(EvictionTest, NobodyGoesWhereRaysWaitEverywhere) {
  waiting_.assign(4, 1);
  for (const EvictionKind kind : {EvictionKind::clock, EvictionKind::demand}) {
    EXPECT_FALSE(choose(*make_eviction(kind)));
  }
}

TEST_F(EvictionTest, FramesWithoutAPageAreNotChosen) {
  pages_ = {kNoPage, PageId{1}, kNoPage, kNoPage};
  for (const EvictionKind kind : {EvictionKind::clock, EvictionKind::demand}) {
    EXPECT_EQ(choose(*make_eviction(kind)), 1u);
  }
}

class ManyFramesTest : public EvictionTest {
 protected:
  static constexpr std::uint32_t kFrames = 10 * DemandEviction::kPool;
  ManyFramesTest() : EvictionTest(kFrames) {}
};

TEST_F(ManyFramesTest, DemandChoosesAmongThoseThatTheHandFound) {
  const auto eviction = make_eviction(EvictionKind::demand);
  for (std::uint32_t frame = 0; frame < kFrames; ++frame) {
    future_[frame] = static_cast<std::int32_t>(kFrames - frame);
  }
  EXPECT_EQ(choose(*eviction), DemandEviction::kPool - 1);
  EXPECT_EQ(choose(*eviction), DemandEviction::kPool) << "the hand has put one more there";
  touched_[DemandEviction::kPool + 1] = 1;
  EXPECT_EQ(choose(*eviction), DemandEviction::kPool + 2) << "what was entered lately is passed by";
}

TEST_F(ManyFramesTest, PageOfThePoolThatIsEnteredIsSpared) {
  const auto eviction = make_eviction(EvictionKind::demand);
  EXPECT_EQ(choose(*eviction), 0u) << "among equals the one that is there longest";
  touched_[1] = 1;
  waiting_[2] = 1;
  EXPECT_EQ(choose(*eviction), 3u);
}

TEST_F(ManyFramesTest, TheLastPageThatMayGoIsFound) {
  const auto eviction = make_eviction(EvictionKind::demand);
  waiting_.assign(kFrames, 1);
  waiting_[kFrames - 2] = 0;
  touched_[kFrames - 2] = 1;
  EXPECT_EQ(choose(*eviction), kFrames - 2);
}

}  // namespace
}  // namespace raymill::storage
