#include "traversal/waiting_rays.h"

#include <gtest/gtest.h>

#include <map>
#include <set>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace raymill::traversal {
namespace {

using storage::PageId;

constexpr std::uint32_t kWaitPages = 50;
constexpr std::size_t kExtentBytes = 8192;

class WaitingRaysTest : public testing::Test {
 protected:
  WaitingRaysTest() {
    WaitingRays::Config config;
    config.layout = RecordLayout(Field::uv | Field::ids);
    config.page_count = kWaitPages;
    config.group_pages = 8;
    config.pool_chunks = 4000;
    config.extent_bytes = kExtentBytes;
    config.most_extents = 100;
    config.directory = folder_.path();
    bytes_ = WaitingRays::table_bytes(config) + config.pool_chunks * kRayChunkBytes;
    waiting_ = std::move(*WaitingRays::create(config, ledger_));
  }
  void put(std::uint32_t page) {
    RayState ray;
    ray.number = next_++;
    ray.has_hit = random_.below(2) == 0;
    ray.hit.primitive_id = ray.number;
    ray.stack.words[0] = random_.next() >> random_.below(64);
    const RecordLayout& layout = waiting_->pool().layout();
    std::byte* record = waiting_->append(PageId{page}, layout.bytes(ray));
    ASSERT_NE(record, nullptr);
    layout.pack(ray, record);
    pages_[ray.number] = page;
  }
  // Takes all rays of the page; each must have been put there.
  void take(std::uint32_t page) {
    RayQueue batch = waiting_->take(PageId{page}, 0xFFFFFFFF);
    waiting_->pool().for_each(batch, [&](const std::byte* record) {
      RayState ray;
      waiting_->pool().layout().unpack(record, ray);
      EXPECT_TRUE(taken_.insert(ray.number).second);
      EXPECT_EQ(pages_[ray.number], page);
      EXPECT_EQ(ray.hit.primitive_id, ray.has_hit ? ray.number : kNoId);
    });
    waiting_->pool().release(batch);
  }
  std::span<std::byte> buffer() { return {memory_.data(), kExtentBytes}; }
  std::uint32_t send(std::uint32_t group, std::uint32_t but_not = kWaitPages) {
    auto parcel = waiting_->detach(group, [&](PageId page) { return index_of(page) != but_not; });
    EXPECT_TRUE(waiting_->store(parcel, buffer()).ok());
    waiting_->retire(parcel);
    return parcel.rays;
  }
  std::uint32_t bring(std::uint32_t group) {
    const std::uint32_t before = waiting_->free_chunks();
    const std::uint32_t chunks = waiting_->chunks_for(*waiting_->oldest(group));
    const auto extent = waiting_->begin_fetch(group);
    EXPECT_TRUE(waiting_->fetch(extent, buffer()).ok());
    std::uint32_t rays = 0;
    waiting_->accept(extent, buffer().first(extent.bytes), [&](PageId page, std::uint32_t count) {
      EXPECT_EQ(waiting_->group_of(page), group);
      rays += count;
    });
    EXPECT_EQ(rays, extent.rays);
    EXPECT_LE(before - waiting_->free_chunks(), chunks);
    return rays;
  }

  storage::Ledger ledger_{mebibytes(16)};
  tests::TempFolder folder_;
  tests::Random random_{7};
  storage::MappedMemory memory_{kExtentBytes};
  std::unique_ptr<WaitingRays> waiting_;
  std::uint64_t bytes_ = 0;
  std::uint32_t next_ = 0;
  std::map<std::uint32_t, std::uint32_t> pages_;  // by number
  std::set<std::uint32_t> taken_;
};

TEST_F(WaitingRaysTest, GroupGoesToDiskAndComesBackWhole) {
  for (std::uint32_t i = 0; i < 100; ++i) {
    put(8 + i % 8);
    put(3);
  }
  EXPECT_EQ(waiting_->memory_rays(1), 100u);
  EXPECT_EQ(send(1), 100u);
  EXPECT_EQ(waiting_->memory_rays(1), 0u);
  EXPECT_EQ(waiting_->disk_rays(1), 100u);
  EXPECT_EQ(waiting_->memory_rays(0), 100u);
  EXPECT_EQ(waiting_->count(PageId{9}), 0u);
  EXPECT_EQ(folder_.files(), 0u) << "the file has no name";
  EXPECT_EQ(bring(1), 100u);
  EXPECT_EQ(waiting_->rays_on_disk(), 0u);
  for (std::uint32_t page = 0; page < kWaitPages; ++page) {
    take(page);
  }
  EXPECT_EQ(taken_.size(), 200u);
}

TEST_F(WaitingRaysTest, PagesThatMayNotGoStay) {
  for (std::uint32_t i = 0; i < 40; ++i) {
    put(i % 8);
  }
  EXPECT_EQ(send(0, 5), 35u);
  EXPECT_EQ(waiting_->count(PageId{5}), 5u);
}

TEST_F(WaitingRaysTest, GroupLargerThanAnExtentGoesInSeveral) {
  for (std::uint32_t i = 0; i < 1000; ++i) {
    put(0);
  }
  int parcels = 0;
  while (waiting_->memory_rays(0) > 0) {
    EXPECT_GT(send(0), 50u);
    ++parcels;
  }
  EXPECT_GT(parcels, 4);
  EXPECT_EQ(waiting_->disk_rays(0), 1000u);
}

TEST_F(WaitingRaysTest, RaysThatAreFlippedOnTheWayAreNoticed) {
  put(0);
  auto parcel = waiting_->detach(0, [](PageId) { return true; });
  ASSERT_TRUE(waiting_->store(parcel, buffer()).ok());
  parcel.checksum ^= 1;
  waiting_->retire(parcel);
  const auto extent = waiting_->begin_fetch(0);
  EXPECT_EQ(waiting_->fetch(extent, buffer()).code(), ErrorCode::checksum_mismatch);
}

TEST_F(WaitingRaysTest, PromisedChunksAreNotFree) {
  const std::uint32_t free_chunks = waiting_->free_chunks();
  waiting_->promise(100);
  EXPECT_EQ(waiting_->free_chunks(), free_chunks - 100);
  waiting_->promise(1 << 20);
  EXPECT_EQ(waiting_->free_chunks(), 0u);
  waiting_->settle(100 + (1 << 20));
  EXPECT_EQ(waiting_->free_chunks(), free_chunks);
}

TEST_F(WaitingRaysTest, ClaimsWhatItSays) { EXPECT_EQ(ledger_.used_bytes(storage::Tag::rays), bytes_); }

TEST_F(WaitingRaysTest, AnyHistoryKeepsEveryRayOnce) {
  for (int step = 0; step < 3000; ++step) {
    const std::uint32_t group = random_.below(waiting_->group_count());
    switch (random_.below(4)) {
      case 0:
        for (std::uint32_t i = random_.below(20); i > 0; --i) {
          put(random_.below(kWaitPages));
        }
        break;
      case 1:
        if (waiting_->memory_rays(group) > 0 && waiting_->has_extents_left()) {
          send(group, random_.below(kWaitPages));
        }
        break;
      case 2:
        if (waiting_->oldest(group) != nullptr && waiting_->free_chunks() > 200) {
          bring(group);
        }
        break;
      default:
        take(random_.below(kWaitPages));
    }
  }
  for (std::uint32_t group = 0; group < waiting_->group_count(); ++group) {
    while (waiting_->oldest(group) != nullptr) {
      bring(group);
    }
  }
  for (std::uint32_t page = 0; page < kWaitPages; ++page) {
    take(page);
  }
  EXPECT_EQ(taken_.size(), next_);
  EXPECT_GT(next_, 3000u);
}

}  // namespace
}  // namespace raymill::traversal
