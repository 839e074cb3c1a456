#include "traversal/ray_state.h"

#include <gtest/gtest.h>

#include <cstring>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/rays.h"

namespace raymill::traversal {
namespace {

RayState ray_at(unsigned width, unsigned levels, tests::Random& random) {
  RayState ray;
  ray.org = {1, 2, 3};
  ray.dir = {-0.0F, 5, 1e-38F};
  ray.tfar = 7;
  ray.number = 0xFEDCBA98;
  ray.node = 65534;
  ray.resume = Resume::backtrack;
  ray.level = static_cast<std::uint8_t>(levels - 1);
  for (unsigned bit = 0; bit < width * levels; ++bit) {
    ray.stack.words[bit / 64] |= (random.next() & 1) << (bit % 64);
  }
  return ray;
}

TEST(RecordLayout, RecordGivesTheRayBackForEveryDepth) {
  tests::Random random(4);
  const RecordLayout layout(Field::all);
  std::vector<std::byte> record(layout.most_bytes());
  for (const unsigned width : {4u, 8u}) {
    for (unsigned levels = 1; levels <= storage::max_levels(width); ++levels) {
      RayState ray = ray_at(width, levels, random);
      ray.tnear = levels % 2 == 0 ? 0.25F : 0.0F;
      ray.has_hit = levels % 3 != 0;
      if (ray.has_hit) {
        ray.hit = {ray.tfar, 0.5F, 0.25F, 4, 5, kNoId, {1, -2, 3}};
      }
      const std::size_t bytes = layout.pack(ray, record.data());
      EXPECT_EQ(bytes, layout.bytes(ray));
      EXPECT_EQ(bytes, layout.bytes(record.data()));
      EXPECT_LE(bytes, layout.most_bytes());
      EXPECT_GE(bytes, RecordLayout::kLeastBytes);
      RayState back;
      back.done = true;
      layout.unpack(record.data(), back);
      EXPECT_EQ(std::memcmp(&back.org, &ray.org, sizeof ray.org), 0);
      EXPECT_EQ(std::memcmp(&back.dir, &ray.dir, sizeof ray.dir), 0);
      EXPECT_EQ(back.tnear, ray.tnear);
      EXPECT_EQ(back.tfar, ray.tfar);
      EXPECT_EQ(back.number, ray.number);
      EXPECT_EQ(back.node, ray.node);
      EXPECT_EQ(back.resume, ray.resume);
      EXPECT_EQ(back.level, ray.level);
      EXPECT_EQ(back.has_hit, ray.has_hit);
      EXPECT_FALSE(back.done);
      EXPECT_TRUE(tests::same_bits(back.hit, ray.hit));
      EXPECT_EQ(back.stack.words, ray.stack.words) << width << " x " << levels;
    }
  }
}

TEST(RecordLayout, CornersOfTheHitComeBackWhereTheyAreKept) {
  tests::Random random(5);
  RayState ray = ray_at(8, 16, random), back;
  ray.has_hit = true;
  ray.corners = {{{1, 2, 3}, {4, 5, 6}, {-7, 8, 0x1p-149F}}};
  for (const KeptCorners kept : {KeptCorners::none, KeptCorners::of_hit}) {
    const RecordLayout layout(Field::all, kept);
    std::vector<std::byte> record(layout.most_bytes());
    const std::size_t bytes = layout.pack(ray, record.data());
    EXPECT_EQ(bytes, layout.bytes(record.data()));
    layout.unpack(record.data(), back);
    EXPECT_EQ(back.corners == ray.corners, kept == KeptCorners::of_hit);
    EXPECT_EQ(back.stack.words, ray.stack.words);
  }
}

TEST(RecordLayout, CountSkippedPrimitiveMaskAndRestOfOrgComeBackWhereTheyAreKept) {
  tests::Random random(6);
  RayState ray = ray_at(8, 16, random), back;
  ray.tnear = 0.5F;
  ray.has_hit = true;
  ray.hit.count = 0x01020304;
  ray.skipped = {7, 8};
  ray.mask = 0x50;
  ray.org_rest = {0.25F, -1, 3};
  for (const KeptExtras kept : {KeptExtras{},
                                {.skipped = true},
                                {.mask = true},
                                {.skipped = true, .mask = true},
                                {.skipped = true, .mask = true, .org_rest = true}}) {
    const RecordLayout layout(Field::count, KeptCorners::none, kept);
    std::vector<std::byte> record(layout.most_bytes());
    const std::size_t bytes = layout.pack(ray, record.data());
    EXPECT_EQ(bytes, layout.bytes(record.data()));
    layout.unpack(record.data(), back);
    EXPECT_EQ(back.hit.count, ray.hit.count);
    EXPECT_EQ(back.skipped, kept.skipped ? ray.skipped : PrimitiveIds());
    EXPECT_EQ(back.mask, kept.mask ? ray.mask : kAllMask);
    EXPECT_EQ(back.org_rest, kept.org_rest ? ray.org_rest : (std::array<float, 3>{}));
    EXPECT_EQ(back.tnear, ray.tnear);
    EXPECT_EQ(back.stack.words, ray.stack.words);
  }
}

TEST(RecordLayout, WhatARayDoesNotNeedTakesNoByte) {
  RayState ray;
  const RecordLayout layout(Field::t | Field::ids);
  EXPECT_EQ(layout.bytes(ray), 36u);
  ray.stack.words[0] = 0x100;
  EXPECT_EQ(layout.bytes(ray), 38u);
  ray.tnear = 1;
  EXPECT_EQ(layout.bytes(ray), 42u);
  ray.has_hit = true;
  EXPECT_EQ(layout.bytes(ray), 50u) << "two ids; t is tfar";
  EXPECT_EQ(RecordLayout(Field::none).bytes(ray), 42u);
  EXPECT_EQ(RecordLayout(Field::none, KeptCorners::of_hit).bytes(ray), 78u) << "in mode exact, the hit's corners";
  ray.has_hit = false;
  EXPECT_EQ(RecordLayout(Field::none, KeptCorners::of_hit).bytes(ray), 42u);
  EXPECT_EQ(RecordLayout(Field::count).bytes(ray), 42u) << "nothing is counted yet";
  EXPECT_EQ(RecordLayout(Field::none, KeptCorners::none, {.skipped = true}).bytes(ray), 50u);
  EXPECT_EQ(RecordLayout(Field::none, KeptCorners::none, {.mask = true}).bytes(ray), 46u);
  EXPECT_EQ(RecordLayout(Field::none, KeptCorners::none, {.org_rest = true}).bytes(ray), 54u);
  ray.has_hit = true;
  EXPECT_EQ(RecordLayout(Field::count).bytes(ray), 46u);
}

}  // namespace
}  // namespace raymill::traversal
