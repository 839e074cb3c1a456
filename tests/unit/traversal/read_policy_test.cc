#include "traversal/read_policy.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/support/random.h"

namespace raymill::traversal {
namespace {

TEST(ReadPolicy, NamesAreReadBack) {
  for (const ReadOrder order : {ReadOrder::score, ReadOrder::most_rays, ReadOrder::fifo, ReadOrder::sweep}) {
    EXPECT_EQ(*parse_read_order(std::string(to_string(order))), order);
  }
  EXPECT_EQ(parse_read_order("lifo").status().code(), ErrorCode::invalid_argument);
}

TEST(ReadPolicy, ScoreWeighsRaysAgainstBytes) {
  const auto bytes = [](std::uint32_t page) { return page == 0 ? 100'000U : 1'000U; };
  const auto score = make_read_policy(ReadOrder::score, 2, bytes);
  const auto most_rays = make_read_policy(ReadOrder::most_rays, 2, bytes);
  for (ReadPolicy* policy : {score.get(), most_rays.get()}) {
    policy->update(0, 200);
    policy->update(1, 50);
  }
  EXPECT_EQ(score->next(), 1u);
  EXPECT_EQ(most_rays->next(), 0u);
}

TEST(ReadPolicy, SweepGoesRoundAndPassesOverPagesThatFewRaysWant) {
  const auto sweep = make_read_policy(ReadOrder::sweep, 200, nullptr);
  for (const std::uint32_t page : {5u, 70u, 130u, 199u}) {
    sweep->update(page, 100);
  }
  sweep->update(80, 1);
  std::vector<std::uint32_t> order;
  for (int i = 0; i < 4; ++i) {
    const auto page = sweep->next();
    ASSERT_TRUE(page);
    order.push_back(*page);
    sweep->update(*page, 0);
  }
  EXPECT_EQ(order, (std::vector<std::uint32_t>{5, 70, 130, 199}));
  EXPECT_EQ(sweep->next(), 80u) << "nothing else is left";
  sweep->update(80, 0);
  EXPECT_EQ(sweep->next(), std::nullopt);
  sweep->update(3, 1);
  EXPECT_EQ(sweep->next(), 3u) << "from the beginning again";
}

TEST(ReadPolicy, FifoIsTheOrderOfTheFirstWish) {
  const auto fifo = make_read_policy(ReadOrder::fifo, 10, nullptr);
  fifo->update(7, 1);
  fifo->update(2, 1000);
  fifo->update(7, 2);
  EXPECT_EQ(fifo->next(), 7u);
  fifo->update(7, 0);
  EXPECT_EQ(fifo->next(), 2u);
}

// Against plain arrays: a choice is always a page that is wanted, and for the lists within 1.5 of the best.
TEST(ReadPolicy, EveryChoiceIsWantedAndNearTheBest) {
  constexpr std::uint32_t kPages = 150;
  const auto bytes = [](std::uint32_t page) { return 1 + page * page; };
  for (const ReadOrder order : {ReadOrder::score, ReadOrder::most_rays, ReadOrder::fifo, ReadOrder::sweep}) {
    tests::Random random(3);
    const auto policy = make_read_policy(order, kPages, bytes);
    std::vector<std::uint32_t> rays(kPages);
    for (int step = 0; step < 20000; ++step) {
      const std::uint32_t page = random.below(kPages);
      rays[page] = random.below(3) == 0 ? 0 : random.below(random.below(5) == 0 ? 100000 : 50);
      policy->update(page, rays[page]);
      const auto choice = policy->next();
      const std::uint32_t most = *std::max_element(rays.begin(), rays.end());
      ASSERT_EQ(choice.has_value(), most > 0);
      if (choice) {
        ASSERT_GT(rays[*choice], 0u);
        if (order == ReadOrder::most_rays) {
          ASSERT_GE(rays[*choice] * 3, most * 2) << "lists are half powers of two";
        }
      }
    }
  }
}

}  // namespace
}  // namespace raymill::traversal
