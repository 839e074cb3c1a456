#include "traversal/hit_lists.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <tuple>
#include <vector>

#include "tests/support/rays.h"
#include "tests/support/temp_folder.h"

namespace raymill::traversal {
namespace {

using tests::Random;

constexpr std::uint32_t kChunkRays = 16;
constexpr std::size_t kBlockBytes = 256;

struct Found {
  std::uint16_t position;
  Hit hit;
};
using Lists = std::vector<std::vector<Hit>>;

class HitListsTest : public testing::Test {
 protected:
  HitLists::Config config(Field asked, std::size_t sort_bytes, std::size_t piece_bytes = 1024) {
    return {asked, 0, kBlockBytes, kChunkRays, sort_bytes, piece_bytes, 2, folder_.path()};
  }
  // Hits of the chunk's rays in any order, some at the same t.
  std::vector<Found> draw(std::size_t count, std::uint32_t rays) {
    std::vector<Found> found(count);
    for (std::uint32_t i = 0; i < count; ++i) {
      Hit& hit = found[i].hit;
      found[i].position = static_cast<std::uint16_t>(random_.below(rays));
      hit.t = float(int(random_.below(40)) - 20) * 0.25F;
      hit.t = hit.t == 0 && random_.below(2) == 0 ? -0.0F : hit.t;
      hit.u = random_.uniform(0, 1);
      hit.geometry_id = random_.below(3);
      hit.primitive_id = i;
    }
    return found;
  }
  // Each list as it is to be: by t, then ids.
  static Lists sorted(const std::vector<Found>& found, std::uint32_t rays, std::uint64_t first = 0) {
    Lists lists(rays);
    for (const Found& one : found) {
      lists[one.position].push_back(one.hit);
    }
    for (auto& list : lists) {
      std::sort(list.begin(), list.end(), [](const Hit& a, const Hit& b) {
        return std::tie(a.t, a.geometry_id, a.primitive_id) < std::tie(b.t, b.geometry_id, b.primitive_id);
      });
      list.resize(std::min<std::size_t>(list.size(), first == 0 ? list.size() : first));
    }
    return lists;
  }
  // What comes out when the hits go in as blocks.
  static Lists pass_through(HitLists& lists, Field asked, const std::vector<Found>& found, std::uint32_t rays) {
    const HitLayout kept(HitLists::kept(asked));
    const std::size_t entry_bytes = RowBlock::entry_bytes(kept.row_bytes());
    lists.begin(rays);
    alignas(8) std::array<std::byte, kBlockBytes> block;
    for (std::size_t i = 0; i < found.size();) {
      RowBlock head;
      for (; i < found.size() && head.rows < RowBlock::room(kBlockBytes, kept.row_bytes()); ++i, ++head.rows) {
        std::byte* entry = block.data() + sizeof(RowBlock) + head.rows * entry_bytes;
        std::memcpy(entry, &found[i].position, sizeof found[i].position);
        kept.write(found[i].hit, entry + sizeof found[i].position);
      }
      std::memcpy(block.data(), &head, sizeof head);
      EXPECT_TRUE(lists.take(block.data()).ok());
    }
    return drain(lists, asked, rays);
  }
  static Lists drain(HitLists& lists, Field asked, std::uint32_t rays) {
    const HitLayout row(asked);
    Lists out(1);
    HitLists::Piece piece;
    std::uint32_t pieces = 0;
    do {
      piece.number = lists.take_piece();
      EXPECT_TRUE(lists.fill(piece).ok());
      EXPECT_EQ(piece.first_position, out.size() - 1);
      for (std::size_t i = 0; i + 1 < piece.offsets.size(); ++i) {
        for (std::uint32_t k = piece.offsets[i]; k < piece.offsets[i + 1]; ++k) {
          out.back().push_back(row.read(piece.rows.data() + k * row.row_bytes()));
        }
        if (!piece.goes_on || i + 2 < piece.offsets.size()) {
          out.emplace_back();
        }
      }
      lists.give_piece(piece.number);
    } while (!piece.is_last && ++pieces < 100'000);
    out.pop_back();
    EXPECT_EQ(out.size(), rays);
    return out;
  }
  static void expect_same(const Lists& a, const Lists& b, Field asked) {
    const HitLayout row(asked);
    std::vector<std::byte> bytes(row.row_bytes());
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      ASSERT_EQ(a[i].size(), b[i].size()) << "ray " << i;
      for (std::size_t k = 0; k < a[i].size(); ++k) {
        row.write(b[i][k], bytes.data());
        ASSERT_TRUE(tests::same_bits(a[i][k], row.read(bytes.data()))) << "ray " << i << ", hit " << k;
      }
    }
  }

  Random random_{1};
  tests::TempFolder folder_;
};

TEST_F(HitListsTest, WhatTheAreaHoldsIsSortedInMemory) {
  for (const Field asked : {kDefaultClosestFields, Field::all, Field::ids, Field::t | Field::uv}) {
    HitLists lists(config(asked, 1 << 16));
    for (const std::uint32_t rays : {kChunkRays, 1u, 5u}) {
      const auto found = draw(rays == 5 ? 0 : 300, rays);
      expect_same(pass_through(lists, asked, found, rays), sorted(found, rays), asked);
    }
    EXPECT_EQ(lists.spilled_bytes(), 0u);
  }
}

TEST_F(HitListsTest, AnyNumberOfHitsIsSortedInTheSameMemory) {
  const Field asked = kDefaultClosestFields;
  HitLists lists(config(asked, 2048));  // seven blocks
  for (const std::size_t count : {60, 500, 8000}) {
    for (const std::uint32_t rays : {kChunkRays, 1u}) {
      const auto found = draw(count, rays);
      expect_same(pass_through(lists, asked, found, rays), sorted(found, rays), asked);
    }
  }
  EXPECT_GT(lists.spilled_bytes(), 3 * 2 * 8000u * 22) << "runs of runs of runs";
  EXPECT_EQ(folder_.files(), 0u) << "what was spilled has no name";
}

TEST_F(HitListsTest, EachHitIsWrittenAsOftenAsTheLogarithmSays) {
  const Field asked = kDefaultClosestFields;
  std::uint64_t last = 0;
  for (const std::size_t count : {2000, 4000, 8000, 16000}) {
    HitLists lists(config(asked, 8192));  // 31 blocks: two levels are enough for all
    const auto found = draw(count, kChunkRays);
    expect_same(pass_through(lists, asked, found, kChunkRays), sorted(found, kChunkRays), asked);
    EXPECT_LE(lists.spilled_bytes(), 3 * count * 26) << "once or twice, and the ends of blocks";
    EXPECT_GT(lists.spilled_bytes(), last);
    last = lists.spilled_bytes();
  }
}

TEST_F(HitListsTest, FirstHitsAloneAreKeptAndLittleOfTheOthersGoesToDisk) {
  const Field asked = kDefaultClosestFields;
  const auto found = draw(8000, kChunkRays);
  HitLists all(config(asked, 2048));
  (void)pass_through(all, asked, found, kChunkRays);
  for (const std::uint64_t first : {1u, 2u, 7u}) {
    HitLists::Config few = config(asked, 2048);
    few.first = first;
    HitLists lists(few);
    expect_same(pass_through(lists, asked, found, kChunkRays), sorted(found, kChunkRays, first), asked);
    EXPECT_LT(lists.spilled_bytes(), all.spilled_bytes());
  }
}

TEST_F(HitListsTest, ARayWithMoreThanAPieceHoldsGoesOnInTheNext) {
  const Field asked = Field::t;
  // Room for seven rows beside the offsets.
  HitLists lists(config(asked, 1 << 16, (kChunkRays + 1 + 7) * sizeof(std::uint32_t)));
  for (const std::size_t count : {7, 8, 14, 15, 100}) {
    for (const std::uint32_t rays : {1u, 3u}) {
      const auto found = draw(count, rays);
      expect_same(pass_through(lists, asked, found, rays), sorted(found, rays), asked);
    }
  }
}

TEST_F(HitListsTest, AFolderThatIsNotThereIsAnError) {
  HitLists::Config lost = config(kDefaultClosestFields, 2048);
  lost.directory = folder_ / "none";
  HitLists lists(lost);
  lists.begin(1);
  alignas(8) std::array<std::byte, kBlockBytes> block{};
  RowBlock head;
  head.rows = RowBlock::room(kBlockBytes, HitLayout(kDefaultClosestFields).row_bytes());
  std::memcpy(block.data(), &head, sizeof head);
  Status status;
  for (int i = 0; i < 100 && status.ok(); ++i) {
    status = lists.take(block.data());
  }
  EXPECT_EQ(status.code(), ErrorCode::io) << status.message();
}

}  // namespace
}  // namespace raymill::traversal
