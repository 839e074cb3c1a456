#include "traversal/page_scheduler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <vector>

#include "tests/support/random.h"

namespace raymill::traversal {
namespace {

using storage::PageId;

TEST(PageScheduler, FullestPageIsReadFirst) {
  PageScheduler scheduler(4, make_read_policy(ReadOrder::most_rays, 4, nullptr));
  scheduler.add(PageId{0}, 3, PageState::absent);
  scheduler.add(PageId{1}, 100, PageState::absent);
  scheduler.add(PageId{2}, 20, PageState::absent);
  EXPECT_EQ(scheduler.next_wanted(), PageId{1});
  scheduler.reading(PageId{1});
  EXPECT_EQ(scheduler.next_wanted(), PageId{2});
  EXPECT_EQ(scheduler.demand()[1], 100u);
}

TEST(PageScheduler, FullestPageIsKnownToAFactorOfTwo) {
  PageScheduler scheduler(3, make_read_policy(ReadOrder::fifo, 3, nullptr));
  EXPECT_EQ(scheduler.most_wanted_rays(), 0u);
  scheduler.add(PageId{0}, 3, PageState::absent);
  scheduler.add(PageId{1}, 100, PageState::absent);
  scheduler.add(PageId{2}, 5000, PageState::resident);
  EXPECT_GT(scheduler.most_wanted_rays(), 50u);
  EXPECT_LE(scheduler.most_wanted_rays(), 100u);
  scheduler.remove(PageId{1}, 99);
  EXPECT_GT(scheduler.most_wanted_rays(), 1u);
  EXPECT_LE(scheduler.most_wanted_rays(), 3u);
  scheduler.reading(PageId{0});
  EXPECT_EQ(scheduler.most_wanted_rays(), 1u);
}

TEST(PageScheduler, RaysThatAddUpMoveAPageAhead) {
  PageScheduler scheduler(2, make_read_policy(ReadOrder::most_rays, 2, nullptr));
  scheduler.add(PageId{0}, 10, PageState::absent);
  scheduler.add(PageId{1}, 5, PageState::absent);
  EXPECT_EQ(scheduler.next_wanted(), PageId{0});
  scheduler.add(PageId{1}, 30, PageState::absent);
  EXPECT_EQ(scheduler.next_wanted(), PageId{1});
  scheduler.remove(PageId{1}, 33);
  EXPECT_EQ(scheduler.next_wanted(), PageId{0});
}

TEST(PageScheduler, LonelyPageIsNotForgottenHoweverFullOthersAre) {
  PageScheduler scheduler(3, make_read_policy(ReadOrder::most_rays, 3, nullptr));
  scheduler.add(PageId{0}, 1, PageState::absent);
  scheduler.add(PageId{1}, 1000, PageState::absent);
  scheduler.add(PageId{2}, 1000, PageState::absent);
  bool picked = false;
  for (int i = 0; i < 200; ++i) {
    picked = picked || scheduler.next_wanted() == PageId{0};
  }
  EXPECT_TRUE(picked);
}

TEST(PageScheduler, ResidentPagesAreReadyInTheOrderTheyCame) {
  PageScheduler scheduler(3, make_read_policy(ReadOrder::most_rays, 3, nullptr));
  scheduler.add(PageId{2}, 1, PageState::resident);
  scheduler.add(PageId{0}, 500, PageState::resident);
  scheduler.add(PageId{2}, 9, PageState::resident);
  EXPECT_EQ(scheduler.take_ready(), PageId{2});
  EXPECT_EQ(scheduler.take_ready(), PageId{0});
  EXPECT_EQ(scheduler.take_ready(), std::nullopt);
  scheduler.remove(PageId{2}, 4);
  scheduler.give_back(PageId{2});
  EXPECT_EQ(scheduler.take_ready(), PageId{2}) << "rays still wait there";
  scheduler.remove(PageId{2}, 6);
  scheduler.give_back(PageId{2});
  EXPECT_FALSE(scheduler.has_ready());
}

TEST(PageScheduler, ReadyPageWhoseRaysWentIsPassedOver) {
  PageScheduler scheduler(2, make_read_policy(ReadOrder::most_rays, 2, nullptr));
  scheduler.add(PageId{0}, 5, PageState::resident);
  scheduler.add(PageId{1}, 5, PageState::resident);
  scheduler.remove(PageId{0}, 5);
  EXPECT_EQ(scheduler.take_ready(), PageId{1});
}

TEST(PageScheduler, PageThatCouldNotBeReadIsACandidateAgain) {
  PageScheduler scheduler(1, make_read_policy(ReadOrder::most_rays, 1, nullptr));
  scheduler.add(PageId{0}, 5, PageState::absent);
  scheduler.reading(PageId{0});
  scheduler.add(PageId{0}, 5, PageState::reading);
  EXPECT_EQ(scheduler.wanted_count(), 0u);
  EXPECT_EQ(scheduler.wanted_rays(), 0u);
  scheduler.arrived(PageId{0}, false);
  EXPECT_EQ(scheduler.next_wanted(), PageId{0});
  scheduler.reading(PageId{0});
  scheduler.arrived(PageId{0}, true);
  EXPECT_EQ(scheduler.take_ready(), PageId{0});
}

// Whatever happens, in the end every page with rays is either ready, wanted, or being read.
TEST(PageScheduler, NoPageWithRaysIsEverLost) {
  constexpr std::uint32_t kPages = 40;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    tests::Random random(seed);
    const auto order = static_cast<ReadOrder>(seed % 4);
    PageScheduler scheduler(kPages, make_read_policy(order, kPages, [](std::uint32_t page) { return 1000 + page; }));
    std::vector<std::uint32_t> rays(kPages);
    std::vector<PageState> state(kPages, PageState::absent);
    const auto run_all = [&](PageId page) {
      const std::uint32_t i = index_of(page);
      ASSERT_EQ(state[i], PageState::resident);
      ASSERT_GT(rays[i], 0u);
      const std::uint32_t taken = 1 + random.below(rays[i]);
      scheduler.remove(page, taken);
      rays[i] -= taken;
      scheduler.give_back(page);
    };
    for (int step = 0; step < 3000; ++step) {
      const std::uint32_t i = random.below(kPages);
      switch (random.below(6)) {
        case 0:
        case 1: {
          const std::uint32_t more = 1 + random.below(random.below(10) == 0 ? 5000 : 10);
          scheduler.add(PageId{i}, more, state[i]);
          rays[i] += more;
          break;
        }
        case 2:
          if (const auto page = random.below(9) == 0 ? scheduler.longest_wanted() : scheduler.next_wanted(); page) {
            ASSERT_EQ(state[index_of(*page)], PageState::absent);
            ASSERT_GT(rays[index_of(*page)], 0u);
            scheduler.reading(*page);
            state[index_of(*page)] = PageState::reading;
          }
          break;
        case 3:
          if (state[i] == PageState::reading) {
            const bool good = random.below(4) != 0;
            state[i] = good ? PageState::resident : PageState::absent;
            scheduler.arrived(PageId{i}, good);
          }
          break;
        case 4:
          if (const auto page = scheduler.take_ready(); page) {
            run_all(*page);
          }
          break;
        default:
          if (state[i] == PageState::resident && rays[i] == 0) {
            state[i] = PageState::absent;  // evicted
          } else if (rays[i] > 0) {
            scheduler.remove(PageId{i}, rays[i]);  // its job was cancelled
            rays[i] = 0;
          }
      }
      ASSERT_EQ(scheduler.demand()[i], rays[i]);
    }
    for (int step = 0; step < 100000 && std::accumulate(rays.begin(), rays.end(), 0u) > 0; ++step) {
      if (const auto page = scheduler.take_ready(); page) {
        run_all(*page);
      } else if (const auto wanted = scheduler.next_wanted(); wanted) {
        scheduler.reading(*wanted);
        state[index_of(*wanted)] = PageState::reading;
      } else {
        for (std::uint32_t i = 0; i < kPages; ++i) {
          if (state[i] == PageState::reading) {
            state[i] = PageState::resident;
            scheduler.arrived(PageId{i}, true);
          }
        }
      }
    }
    EXPECT_EQ(std::accumulate(rays.begin(), rays.end(), 0u), 0u) << "seed " << seed;
    EXPECT_EQ(scheduler.wanted_count(), 0u);
    EXPECT_EQ(scheduler.wanted_rays(), 0u);
  }
}

}  // namespace
}  // namespace raymill::traversal
