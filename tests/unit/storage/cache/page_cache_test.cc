#include "storage/cache/page_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstring>
#include <memory>
#include <thread>
#include <vector>

#include "tests/support/random.h"

namespace raymill::storage {
namespace {

constexpr std::uint32_t kPageBytes = 4096;

class PageCacheTest : public testing::Test {
 protected:
  void make(std::uint32_t pages, std::uint32_t frames, unsigned pin_slots = 2) {
    cache_ = std::move(*PageCache::create({pages, kPageBytes, frames, pin_slots}, ledger_));
    demand_.assign(pages, 0);
  }
  // Reads a page in, as far as the cache lets it.
  bool bring(std::uint32_t page) {
    const auto lease = cache_->begin_read(PageId{page}, {demand_, {}});
    if (!lease) {
      return false;
    }
    EXPECT_EQ(lease->bytes.size(), kPageBytes);
    std::memset(lease->bytes.data(), static_cast<int>(page), lease->bytes.size());
    cache_->publish(*lease);
    return true;
  }
  [[nodiscard]] bool resident(std::uint32_t page) const { return cache_->find(PageId{page}) != nullptr; }

  Ledger ledger_{mebibytes(64)};
  std::unique_ptr<PageCache> cache_;
  std::vector<std::uint32_t> demand_;
};

TEST_F(PageCacheTest, PublishedPageIsFoundWithItsBytes) {
  make(4, 2);
  EXPECT_FALSE(resident(3));
  EXPECT_TRUE(cache_->absent(PageId{3}));
  ASSERT_TRUE(bring(3));
  EXPECT_TRUE(cache_->resident(PageId{3}));
  EXPECT_EQ(cache_->find(PageId{3})[kPageBytes - 1], std::byte{3});
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(cache_->find(PageId{3})) % 64, 0u);
}

TEST_F(PageCacheTest, PageThatIsBeingReadIsNotFoundAndAbandonedFramesComeBack) {
  make(4, 1);
  const auto lease = cache_->begin_read(PageId{1}, {demand_, {}});
  ASSERT_TRUE(lease);
  EXPECT_FALSE(resident(1));
  EXPECT_FALSE(cache_->absent(PageId{1}));
  EXPECT_FALSE(cache_->begin_read(PageId{2}, {demand_, {}})) << "the only frame is taken";
  cache_->abandon(*lease);
  EXPECT_TRUE(cache_->absent(PageId{1}));
  EXPECT_TRUE(bring(2));
}

TEST_F(PageCacheTest, FrameWhosePageWentIsNotUnused) {
  make(4, 2);
  EXPECT_TRUE(cache_->has_unused_frame());
  ASSERT_TRUE(bring(0) && cache_->has_unused_frame());
  ASSERT_TRUE(bring(1));
  EXPECT_FALSE(cache_->has_unused_frame());
  cache_->drop(PageId{1});
  EXPECT_FALSE(cache_->has_unused_frame());
  EXPECT_TRUE(bring(2));
}

TEST_F(PageCacheTest, FullCacheEvictsWhatNobodyWants) {
  make(8, 3);
  for (std::uint32_t page = 0; page < 3; ++page) {
    ASSERT_TRUE(bring(page));
  }
  demand_[0] = demand_[2] = 1;
  ASSERT_TRUE(bring(5));
  EXPECT_TRUE(resident(0) && resident(2) && resident(5));
  EXPECT_FALSE(resident(1));
  EXPECT_EQ(cache_->evictions(), 1u);
}

TEST_F(PageCacheTest, WantedPagesAreNeverEvicted) {
  make(8, 3);
  for (std::uint32_t page = 0; page < 3; ++page) {
    ASSERT_TRUE(bring(page));
    demand_[page] = 1;
  }
  EXPECT_FALSE(bring(5));
  EXPECT_TRUE(resident(0) && resident(1) && resident(2));
  demand_[1] = 0;
  EXPECT_TRUE(bring(5));
  EXPECT_FALSE(resident(1));
}

TEST_F(PageCacheTest, PinnedPageSurvivesEviction) {
  make(8, 4);
  for (std::uint32_t page = 0; page < 4; ++page) {
    ASSERT_TRUE(bring(page));
  }
  PagePin pin = cache_->pin(0);
  std::vector<const std::byte*> images;
  for (std::uint32_t page = 0; page < 4; ++page) {
    images.push_back(cache_->find(PageId{page}));
  }
  for (std::uint32_t page = 4; page < 8; ++page) {
    (void)bring(page);
  }
  EXPECT_GT(cache_->evictions(), 0u) << "a page was taken away";
  for (std::uint32_t page = 0; page < 4; ++page) {
    EXPECT_EQ(images[page][100], static_cast<std::byte>(page)) << "and its frame must rest while the pin lives";
  }
  pin.release();
  EXPECT_TRUE(bring(7));
}

TEST_F(PageCacheTest, PinTakenAfterTheEvictionDoesNotKeepTheFrame) {
  make(8, 1);
  ASSERT_TRUE(bring(0));
  PagePin early = cache_->pin(0);
  EXPECT_FALSE(bring(1)) << "page 0 went, but its frame rests";
  EXPECT_FALSE(resident(0));
  PagePin late = cache_->pin(1);
  early.release();
  EXPECT_TRUE(bring(1)) << "the late pin cannot have seen page 0";
}

TEST_F(PageCacheTest, FewFramesRestAtOnce) {
  make(100, 32);
  for (std::uint32_t page = 0; page < 32; ++page) {
    ASSERT_TRUE(bring(page));
  }
  const PagePin pin = cache_->pin(0);
  for (std::uint32_t page = 32; page < 100; ++page) {
    EXPECT_FALSE(bring(page));
  }
  EXPECT_LE(cache_->evictions(), 8u) << "a pin that stays must not empty the cache";
}

TEST_F(PageCacheTest, PageEnteredSinceTheLastSweepIsSparedOnce) {
  make(8, 3);
  for (std::uint32_t page = 0; page < 3; ++page) {
    ASSERT_TRUE(bring(page));
  }
  ASSERT_TRUE(bring(3));  // the first sweep clears every mark, page 0 goes
  EXPECT_FALSE(resident(0));
  cache_->touched()[1] = 1;
  ASSERT_TRUE(bring(4));
  EXPECT_TRUE(resident(1));
  EXPECT_FALSE(resident(2));
}

TEST_F(PageCacheTest, DroppedPageGoesAlthoughItIsWantedAndItsFrameRests) {
  make(4, 2);
  ASSERT_TRUE(bring(1));
  demand_[1] = 5;
  PagePin pin = cache_->pin(0);
  const std::byte* image = cache_->find(PageId{1});
  cache_->drop(PageId{1});
  EXPECT_TRUE(cache_->absent(PageId{1}));
  EXPECT_FALSE(resident(1));
  EXPECT_TRUE(bring(2));
  EXPECT_FALSE(bring(3)) << "the other frame rests while the pin lives";
  EXPECT_EQ(image[0], std::byte{1});
  pin.release();
  EXPECT_TRUE(bring(1));
}

TEST_F(PageCacheTest, EachPageThatGoesIsTold) {
  std::vector<PageId> gone;
  PageCache::Config config{8, kPageBytes, 2, 1};
  config.on_evict = [&](PageId page) { gone.push_back(page); };
  demand_.assign(8, 0);
  cache_ = std::move(*PageCache::create(config, ledger_));
  for (std::uint32_t page = 0; page < 3; ++page) {
    ASSERT_TRUE(bring(page));
  }
  EXPECT_EQ(gone, std::vector<PageId>{PageId{0}});
  EXPECT_EQ(cache_->evictions(), gone.size());
}

TEST_F(PageCacheTest, MemoryIsClaimedExactlyAndGivenBack) {
  make(10, 4);
  EXPECT_EQ(ledger_.used_bytes(Tag::pages), 4u * kPageBytes);
  EXPECT_EQ(ledger_.used_bytes(Tag::directory), PageCache::table_bytes(10, 4));
  cache_.reset();
  EXPECT_EQ(ledger_.free_bytes(), ledger_.budget_bytes());
  Ledger small(3 * kPageBytes);
  EXPECT_EQ(PageCache::create({10, kPageBytes, 4, 1}, small).status().code(), ErrorCode::budget_exceeded);
  EXPECT_EQ(small.free_bytes(), small.budget_bytes());
}

// Readers look at pages through pins while the owner turns the cache over: what a reader found keeps its bytes.
TEST_F(PageCacheTest, ReadersNeverSeeAFrameChangeUnderTheirPin) {
  constexpr std::uint32_t kPages = 24;
  make(kPages, 4, 2);
  std::atomic<bool> stop{false};
  std::vector<std::thread> readers;
  std::atomic<std::uint64_t> looks{0};
  for (unsigned slot = 0; slot < 2; ++slot) {
    readers.emplace_back([&, slot] {
      tests::Random random(slot);
      while (!stop) {
        const PagePin pin = cache_->pin(slot);
        const std::uint32_t page = random.below(kPages);
        if (const std::byte* image = cache_->find(PageId{page}); image != nullptr) {
          for (std::size_t i = 0; i < kPageBytes; i += 512) {
            EXPECT_EQ(image[i], static_cast<std::byte>(page));
          }
          ++looks;
        }
      }
    });
  }
  tests::Random random(9);
  for (int i = 0; i < 200000 && (i < 20000 || looks < 1000); ++i) {
    const std::uint32_t page = random.below(kPages);
    if (cache_->absent(PageId{page})) {
      (void)bring(page);
    }
  }
  stop = true;
  for (std::thread& reader : readers) {
    reader.join();
  }
  EXPECT_GT(cache_->evictions(), 0u);
}

}  // namespace
}  // namespace raymill::storage
