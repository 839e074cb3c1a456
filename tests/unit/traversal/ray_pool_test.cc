#include "traversal/ray_pool.h"

#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "tests/support/random.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {
namespace {

constexpr Field kFields = Field::uv | Field::ids | Field::normal;

// A ray whose record has one of all sizes.
RayState some_ray(tests::Random& random, std::uint32_t number) {
  RayState ray;
  ray.number = number;
  ray.dir = {1, 2, 3};
  ray.tnear = random.below(4) == 0 ? 0.5F : 0.0F;
  ray.has_hit = random.below(3) == 0;
  ray.stack.words[0] = random.next() >> random.below(64);
  ray.stack.words[1] = random.below(2) == 0 ? random.next() >> random.below(64) : 0;
  return ray;
}

bool put(RayPool& pool, RayQueue& queue, const RayState& ray) {
  std::byte* record = pool.append(queue, pool.layout().bytes(ray));
  if (record == nullptr) {
    return false;
  }
  pool.layout().pack(ray, record);
  return true;
}

std::vector<std::uint32_t> numbers(const RayPool& pool, const RayQueue& queue) {
  std::vector<std::uint32_t> all;
  pool.for_each(queue, [&](const std::byte* record) {
    RayState ray;
    pool.layout().unpack(record, ray);
    all.push_back(ray.number);
  });
  return all;
}

class RayPoolTest : public testing::Test {
 protected:
  std::unique_ptr<RayPool> make(std::uint32_t chunks) {
    return *RayPool::create(RecordLayout(kFields), chunks, ledger_);
  }
  storage::Ledger ledger_{mebibytes(16)};
  tests::Random random_{5};
};

TEST_F(RayPoolTest, QueuesKeepTheirRaysInOrderWhateverTheirSizes) {
  const auto pool = make(400);
  RayQueue queues[2];
  std::vector<std::uint32_t> expected[2];
  for (std::uint32_t i = 0; i < 1000; ++i) {
    const unsigned which = i % 3 == 0 ? 0 : 1;
    ASSERT_TRUE(put(*pool, queues[which], some_ray(random_, i)));
    expected[which].push_back(i);
  }
  for (const unsigned which : {0, 1}) {
    EXPECT_EQ(queues[which].count, expected[which].size());
    EXPECT_EQ(numbers(*pool, queues[which]), expected[which]);
  }
}

TEST_F(RayPoolTest, TakesWholeChunksUntilEnoughAreOutOldestFirst) {
  const auto pool = make(100);
  RayQueue queue;
  for (std::uint32_t i = 0; i < 100; ++i) {
    ASSERT_TRUE(put(*pool, queue, some_ray(random_, i)));
  }
  RayQueue taken = pool->take(queue, 30);
  EXPECT_GE(taken.count, 30u);
  EXPECT_LT(taken.count, 30 + RayPool::records_per_chunk(RecordLayout::kLeastBytes));
  EXPECT_EQ(taken.count + queue.count, 100u);
  EXPECT_EQ(numbers(*pool, taken).front(), 0u);
  EXPECT_EQ(numbers(*pool, queue).front(), taken.count);
  ASSERT_TRUE(put(*pool, queue, some_ray(random_, 100)));
  EXPECT_EQ(numbers(*pool, queue).back(), 100u);
  RayQueue rest = pool->take(queue, 1000);
  EXPECT_EQ(queue.count, 0u);
  EXPECT_EQ(rest.count + taken.count, 101u);
  RayQueue none = pool->take(queue, 10);
  EXPECT_EQ(none.count, 0u);
  pool->release(none);
}

TEST_F(RayPoolTest, TakesNoMoreBytesThanAskedFor) {
  const auto pool = make(100);
  RayQueue queue;
  for (std::uint32_t i = 0; i < 200; ++i) {
    ASSERT_TRUE(put(*pool, queue, some_ray(random_, i)));
  }
  std::size_t bytes = 0;
  const RayQueue taken = pool->take_bytes(queue, 2000, bytes);
  EXPECT_LE(bytes, 2000u);
  EXPECT_GT(bytes, 2000 - kRayChunkBytes);
  std::size_t counted = 0;
  pool->for_each_chunk(taken, [&](std::span<const std::byte> records) { counted += records.size(); });
  EXPECT_EQ(counted, bytes);
  EXPECT_EQ(taken.count + queue.count, 200u);
}

TEST_F(RayPoolTest, EmptyPoolGivesNullAndReleasedChunksComeBack) {
  const auto pool = make(2);
  RayQueue queue;
  std::uint32_t rays = 0;
  while (put(*pool, queue, some_ray(random_, rays))) {
    ++rays;
  }
  EXPECT_EQ(queue.count, rays);
  EXPECT_EQ(pool->free_chunks(), 0u);
  pool->release(queue);
  EXPECT_EQ(queue.count, 0u);
  EXPECT_EQ(pool->free_chunks(), 2u);
  EXPECT_TRUE(put(*pool, queue, some_ray(random_, 0)));
}

// However the records of some queues are spread over other queues, they fit the chunks that chunks_for() counts.
TEST_F(RayPoolTest, ChunksForIsEnoughForAnySpread) {
  for (int round = 0; round < 200; ++round) {
    const std::uint32_t queue_count = 1 + random_.below(40);
    std::vector<RayState> rays;
    std::uint64_t bytes = 0;
    const RecordLayout layout(kFields);
    for (std::uint32_t i = 0; i < 1 + random_.below(500); ++i) {
      rays.push_back(some_ray(random_, i));
      bytes += layout.bytes(rays.back());
    }
    const auto pool = make(static_cast<std::uint32_t>(RayPool::chunks_for(bytes, queue_count, layout.most_bytes())));
    std::vector<RayQueue> queues(queue_count);
    for (const RayState& ray : rays) {
      ASSERT_TRUE(put(*pool, queues[random_.below(queue_count)], ray)) << "round " << round;
    }
  }
}

TEST_F(RayPoolTest, ClaimsItsArena) {
  storage::Ledger ledger(10 * kRayChunkBytes);
  EXPECT_EQ(RayPool::create(RecordLayout(kFields), 11, ledger).status().code(), ErrorCode::budget_exceeded);
  const auto pool = RayPool::create(RecordLayout(kFields), 10, ledger);
  EXPECT_TRUE(pool);
  EXPECT_EQ(ledger.free_bytes(), 0u);
}

}  // namespace
}  // namespace raymill::traversal
