#include "traversal/ray_pool.h"

#include <gtest/gtest.h>

#include <cstring>
#include <set>
#include <vector>

#include "tests/support/random.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {
namespace {

constexpr std::size_t kRecordBytes = 44;

void put(RayPool& pool, RayQueue& queue, std::uint32_t value) {
  std::byte* record = pool.append(queue);
  ASSERT_NE(record, nullptr);
  std::memset(record, 0xEE, kRecordBytes);
  std::memcpy(record, &value, sizeof value);
}

std::vector<std::uint32_t> values(const RayPool& pool, const RayQueue& queue) {
  std::vector<std::uint32_t> all;
  pool.for_each(queue, [&](const std::byte* record) {
    std::uint32_t value = 0;
    std::memcpy(&value, record, sizeof value);
    all.push_back(value);
  });
  return all;
}

TEST(RayPool, KeepsEveryRecordOnce) {
  storage::Ledger ledger(mebibytes(4));
  const auto pool = *RayPool::create(kRecordBytes, 400, ledger);
  RayQueue a, b;
  for (std::uint32_t i = 0; i < 1000; ++i) {
    put(*pool, i % 3 == 0 ? a : b, i);
  }
  EXPECT_EQ(a.count + b.count, 1000u);
  std::set<std::uint32_t> seen;
  for (const RayQueue& queue : {a, b}) {
    for (const std::uint32_t value : values(*pool, queue)) {
      EXPECT_TRUE(seen.insert(value).second);
    }
  }
  EXPECT_EQ(seen.size(), 1000u);
}

TEST(RayPool, TakesWholeChunksUntilEnoughAreOut) {
  storage::Ledger ledger(mebibytes(4));
  const auto pool = *RayPool::create(kRecordBytes, 100, ledger);
  const std::size_t per_chunk = RayPool::records_per_chunk(kRecordBytes);
  RayQueue queue;
  for (std::uint32_t i = 0; i < 100; ++i) {
    put(*pool, queue, i);
  }
  RayQueue taken = pool->take(queue, 30);
  EXPECT_GE(taken.count, 30u);
  EXPECT_LT(taken.count, 30 + per_chunk);
  EXPECT_EQ(taken.count + queue.count, 100u);
  EXPECT_EQ(values(*pool, taken).size(), taken.count);
  EXPECT_EQ(values(*pool, queue).size(), queue.count);
  RayQueue rest = pool->take(queue, 1000);
  EXPECT_EQ(queue.count, 0u);
  EXPECT_EQ(rest.count + taken.count, 100u);
  RayQueue none = pool->take(queue, 10);
  EXPECT_EQ(none.count, 0u);
  pool->release(none);
}

TEST(RayPool, EmptyPoolGivesNullAndReleasedChunksComeBack) {
  storage::Ledger ledger(mebibytes(4));
  const auto pool = *RayPool::create(kRecordBytes, 2, ledger);
  const std::size_t per_chunk = RayPool::records_per_chunk(kRecordBytes);
  RayQueue queue;
  for (std::uint32_t i = 0; i < 2 * per_chunk; ++i) {
    put(*pool, queue, i);
  }
  EXPECT_EQ(pool->append(queue), nullptr);
  pool->release(queue);
  EXPECT_EQ(queue.count, 0u);
  EXPECT_NE(pool->append(queue), nullptr);
}

// Any spread of rays over queues, with batches taken out and put elsewhere, fits the chunks that chunks_needed counts.
TEST(RayPool, ChunksNeededIsEnoughForAnySpread) {
  constexpr std::uint32_t kRays = 3000, kQueues = 50;
  for (const std::size_t record_bytes : {std::size_t{36}, std::size_t{51}}) {
    storage::Ledger ledger(mebibytes(16));
    const auto chunks = static_cast<std::uint32_t>(RayPool::chunks_needed(kRays, kQueues, record_bytes));
    const auto pool = *RayPool::create(record_bytes, chunks, ledger);
    tests::Random random(3);
    std::vector<RayQueue> queues(kQueues);
    for (std::uint32_t i = 0; i < kRays; ++i) {
      ASSERT_NE(pool->append(queues[0]), nullptr);
    }
    for (int step = 0; step < 3000; ++step) {
      RayQueue batch = pool->take(queues[random.below(kQueues)], 1 + random.below(600));
      const std::uint32_t count = batch.count;
      if (step % 2 == 0) {
        pool->release(batch);
      }
      for (std::uint32_t i = 0; i < count; ++i) {
        ASSERT_NE(pool->append(queues[random.below(kQueues)]), nullptr) << "step " << step;
      }
      pool->release(batch);
    }
  }
}

TEST(RayPool, ClaimsItsArena) {
  storage::Ledger ledger(10 * kRayChunkBytes);
  EXPECT_EQ(RayPool::create(kRecordBytes, 11, ledger).status().code(), ErrorCode::budget_exceeded);
  const auto pool = RayPool::create(kRecordBytes, 10, ledger);
  EXPECT_TRUE(pool);
  EXPECT_EQ(ledger.free_bytes(), 0u);
}

TEST(RecordLayout, RecordGivesTheRayBackForEveryDepth) {
  tests::Random random(4);
  for (const unsigned width : {4u, 8u}) {
    for (unsigned levels = 1; levels <= storage::max_levels(width); ++levels) {
      const RecordLayout layout(RecordLayout::stack_bytes(width, levels));
      EXPECT_LE(layout.bytes(), 35 + sizeof(Bitstack));
      RayState ray;
      ray.org = {1, 2, 3};
      ray.dir = {-0.0F, 5, 1e-38F};
      ray.tfar = 7;
      ray.number = 0xFEDCBA98;
      ray.node = 65534;
      ray.resume = Resume::backtrack;
      ray.level = static_cast<std::uint8_t>(levels - 1);
      ray.has_hit = true;
      for (unsigned bit = 0; bit < width * levels; ++bit) {
        ray.stack.words[bit / 64] |= (random.next() & 1) << (bit % 64);
      }
      std::vector<std::byte> record(layout.bytes());
      layout.pack(ray, record.data());
      RayState back;
      back.improved = back.done = true;
      layout.unpack(record.data(), back);
      EXPECT_EQ(std::memcmp(&back.org, &ray.org, sizeof ray.org), 0);
      EXPECT_EQ(std::memcmp(&back.dir, &ray.dir, sizeof ray.dir), 0);
      EXPECT_EQ(back.tfar, ray.tfar);
      EXPECT_EQ(back.number, ray.number);
      EXPECT_EQ(back.node, ray.node);
      EXPECT_EQ(back.resume, ray.resume);
      EXPECT_EQ(back.level, ray.level);
      EXPECT_TRUE(back.has_hit);
      EXPECT_FALSE(back.improved || back.done);
      EXPECT_EQ(back.stack.words, ray.stack.words) << width << " x " << levels;
    }
  }
}

}  // namespace
}  // namespace raymill::traversal
