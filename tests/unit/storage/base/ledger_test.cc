#include "storage/base/ledger.h"

#include <gtest/gtest.h>

#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace raymill::storage {
namespace {

TEST(Ledger, ClaimGoesBackWithItsReservation) {
  Ledger ledger(1000);
  {
    const auto claim = ledger.claim(Tag::pages, 600);
    ASSERT_TRUE(claim);
    EXPECT_EQ(claim->bytes(), 600u);
    EXPECT_EQ(ledger.free_bytes(), 400u);
    EXPECT_EQ(ledger.used_bytes(Tag::pages), 600u);
    EXPECT_EQ(ledger.used_bytes(Tag::rays), 0u);
  }
  EXPECT_EQ(ledger.free_bytes(), 1000u);
  EXPECT_EQ(ledger.used_bytes(Tag::pages), 0u);
  EXPECT_EQ(ledger.peak_bytes(Tag::pages), 600u);
}

TEST(Ledger, SumOfTagsNeverPassesTheBudget) {
  Ledger ledger(1000);
  const auto pages = ledger.claim(Tag::pages, 600);
  EXPECT_EQ(ledger.claim(Tag::rays, 401).status().code(), ErrorCode::budget_exceeded);
  EXPECT_EQ(ledger.used_bytes(Tag::rays), 0u) << "a claim that failed must leave nothing behind";
  const auto rest = ledger.claim(Tag::rays, 400);
  EXPECT_TRUE(rest);
  EXPECT_EQ(ledger.free_bytes(), 0u);
}

TEST(Ledger, FailureNamesWhatIsNeededAndWhatIsGiven) {
  Ledger ledger(mebibytes(32));
  const auto held = ledger.claim(Tag::base, mebibytes(11));
  const Status status = ledger.claim(Tag::results, mebibytes(30)).status();
  EXPECT_NE(status.message().find("needs at least 41.0 MiB"), std::string::npos) << status.message();
  EXPECT_NE(status.message().find("32.0 MiB"), std::string::npos) << status.message();
  EXPECT_NE(status.message().find("results"), std::string::npos) << status.message();
}

TEST(Ledger, HugeClaimsDoNotWrapAround) {
  Ledger ledger(1000);
  const auto held = ledger.claim(Tag::base, 10);
  EXPECT_FALSE(ledger.claim(Tag::pages, ~std::uint64_t{0}));
  EXPECT_FALSE(ledger.claim(Tag::pages, ~std::uint64_t{0} - 9));
  EXPECT_EQ(ledger.free_bytes(), 990u);
}

TEST(Ledger, ResizeThatFailsKeepsTheOldClaim) {
  Ledger ledger(1000);
  auto claim = ledger.claim(Tag::build, 500);
  EXPECT_TRUE(claim->resize(900).ok());
  EXPECT_EQ(claim->resize(1001).code(), ErrorCode::budget_exceeded);
  EXPECT_EQ(claim->bytes(), 900u);
  EXPECT_EQ(ledger.used_bytes(Tag::build), 900u);
  EXPECT_TRUE(claim->resize(0).ok());
  EXPECT_EQ(ledger.free_bytes(), 1000u);
  EXPECT_EQ(ledger.peak_bytes(Tag::build), 900u);
}

TEST(Ledger, MoveHandsTheClaimOnAndDropsTheOldOne) {
  Ledger ledger(1000);
  BudgetReservation first = std::move(*ledger.claim(Tag::io, 300));
  BudgetReservation second = std::move(*ledger.claim(Tag::io, 200));
  second = std::move(first);
  EXPECT_EQ(ledger.used_bytes(Tag::io), 300u);
  second = {};
  EXPECT_EQ(ledger.used_bytes(Tag::io), 0u);
}

TEST(Ledger, ThreadsNeverOverdrawIt) {
  constexpr std::uint64_t kBudget = 1000;
  Ledger ledger(kBudget);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (std::uint64_t i = 0; i < 5000; ++i) {
        const auto claim = ledger.claim(t % 2 == 0 ? Tag::pages : Tag::rays, i % 700);
        EXPECT_LE(ledger.used_bytes(Tag::pages), kBudget);
        EXPECT_LE(ledger.free_bytes(), kBudget);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(ledger.free_bytes(), kBudget);
  EXPECT_LE(ledger.peak_bytes(Tag::pages), kBudget);
}

TEST(Ledger, BytesAreWrittenForPeople) {
  EXPECT_EQ(format_bytes(0), "0 B");
  EXPECT_EQ(format_bytes(1023), "1023 B");
  EXPECT_EQ(format_bytes(1536), "1.5 KiB");
  EXPECT_EQ(format_bytes(mebibytes(41)), "41.0 MiB");
  EXPECT_EQ(format_bytes(gibibytes(20)), "20.0 GiB");
}

TEST(Ledger, ProcessKnowsItsResidentMemory) {
  EXPECT_GT(resident_bytes(), 0u);
  EXPECT_GE(peak_resident_bytes() + mebibytes(1), resident_bytes());
}

}  // namespace
}  // namespace raymill::storage
