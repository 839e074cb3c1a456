// ResultWindow where rays have lists of hits.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"
#include "traversal/result_window.h"

namespace raymill::traversal {
namespace {

constexpr Field kAsked = Field::t | Field::ids;

class ListWindowTest : public testing::Test {
 protected:
  static constexpr std::uint32_t kBlocks = 8;
  ResultWindow::Config config() const {
    ResultWindow::Config config{HitLayout(HitLists::kept(kAsked)), 4, 50, kBlocks, 128, folder_.path()};
    config.lists = {kAsked, 0, 128, 16, 1024, 512, ResultWindow::kMostHeld, folder_.path()};
    return config;
  }
  void SetUp() override { window_ = std::move(*ResultWindow::create(config(), ledger_)); }
  // A chunk of rays; gives the first one's number.
  std::uint32_t begin_chunk(std::uint32_t rays) {
    EXPECT_TRUE(window_->begin_slot());
    const std::uint32_t number = window_->next_number();
    window_->add(rays);
    window_->close_slot();
    lists_.resize(lists_.size() + rays);
    return number;
  }
  // A hit more of the ray that is `ray`-th in the job.
  void add_hit(std::uint32_t number, std::size_t ray) {
    Hit hit;
    hit.t = float(random_.below(100));
    hit.primitive_id = next_primitive_++;
    hit.geometry_id = 3;
    ASSERT_TRUE(window_->add_hit(number, hit).ok());
    lists_[ray].push_back({hit.t, hit.primitive_id});
  }
  // The next piece is that of the lists there are, from where the one before ended.
  void fetch() {
    ASSERT_TRUE(window_->deliverable());
    while (window_->begin_blocks()) {
      ASSERT_TRUE(window_->sort_blocks().ok());
      window_->end_blocks();
    }
    HitLists::Piece piece = window_->begin_piece();
    ASSERT_TRUE(window_->fill_piece(piece).ok());
    const auto place = window_->end_piece(piece);
    EXPECT_EQ(place.index, pieces_++);
    ASSERT_EQ(place.first_ray, ray_);
    const HitLayout row(kAsked);
    for (std::size_t i = 0; i + 1 < piece.offsets.size(); ++i) {
      auto& list = lists_[ray_];
      std::sort(list.begin(), list.end());
      for (std::uint32_t k = piece.offsets[i]; k < piece.offsets[i + 1]; ++k) {
        const Hit hit = row.read(piece.rows.data() + k * row.row_bytes());
        ASSERT_EQ((Found{hit.t, hit.primitive_id}), list.at(of_ray_++));
      }
      if (i + 2 < piece.offsets.size() || !piece.goes_on) {
        EXPECT_EQ(of_ray_, list.size());
        of_ray_ = 0;
        ++ray_;
      }
    }
    window_->free_piece(piece.number);
  }

  using Found = std::pair<float, std::uint32_t>;
  tests::TempFolder folder_;
  storage::Ledger ledger_{mebibytes(16)};
  std::unique_ptr<ResultWindow> window_;
  tests::Random random_{1};
  std::vector<std::vector<Found>> lists_;
  std::uint32_t next_primitive_ = 0;
  std::size_t ray_ = 0, of_ray_ = 0;
  std::uint64_t pieces_ = 0;
};

TEST_F(ListWindowTest, ListsComeInOrderWhateverTheOrderOfTheirHits) {
  std::vector<std::uint32_t> numbers;
  for (int chunk = 0; chunk < 4; ++chunk) {
    const std::uint32_t first = begin_chunk(10);
    for (std::uint32_t i = 0; i < 10; ++i) {
      numbers.push_back(first + i);
    }
  }
  for (int i = 0; i < 2000; ++i) {
    const std::uint32_t ray = random_.below(40);
    if (ray % 7 != 0) {
      add_hit(numbers[ray], ray);
    }
  }
  for (std::size_t i = numbers.size(); i-- > 0;) {
    EXPECT_FALSE(window_->deliverable()) << "the first ray is still under way";
    EXPECT_EQ(window_->complete(numbers[i]), i % 10 == 0) << "its chunk is done";
  }
  while (!window_->drained() && !HasFailure()) {
    fetch();
  }
  EXPECT_EQ(ray_, 40u);
  EXPECT_GT(pieces_, 4u);
  EXPECT_EQ(folder_.files(), 0u);
}

// A chunk that is sorted may have every block there is; workers go on all the same.
TEST_F(ListWindowTest, WorkersFindBlocksWhileAChunkIsSorted) {
  const std::uint32_t sorted = begin_chunk(1), other = begin_chunk(1);
  for (std::uint32_t i = 0; i < 20 * kBlocks; ++i) {
    add_hit(sorted, 0);
  }
  EXPECT_TRUE(window_->complete(sorted));
  while (window_->begin_blocks()) {
    for (int i = 0; i < 60; ++i) {
      add_hit(other, 1);
    }
    ASSERT_TRUE(window_->sort_blocks().ok());
    window_->end_blocks();
  }
  EXPECT_TRUE(window_->complete(other));
  while (!window_->drained() && !HasFailure()) {
    fetch();
  }
  EXPECT_EQ(ray_, 2u);
}

TEST_F(ListWindowTest, CallersHoldAFewPiecesAtOnce) {
  const std::uint32_t number = begin_chunk(1);
  for (int i = 0; i < 2000; ++i) {
    add_hit(number, 0);
  }
  window_->complete(number, 1);
  std::vector<std::uint32_t> held;
  while (window_->deliverable()) {
    ASSERT_LT(held.size(), ResultWindow::kMostHeld);
    EXPECT_FALSE(held.empty() ? false : window_->begin_blocks());
    while (window_->begin_blocks()) {
      ASSERT_TRUE(window_->sort_blocks().ok());
      window_->end_blocks();
    }
    HitLists::Piece piece = window_->begin_piece();
    ASSERT_TRUE(window_->fill_piece(piece).ok());
    window_->end_piece(piece);
    held.push_back(piece.number);
  }
  EXPECT_EQ(held.size(), ResultWindow::kMostHeld);
  EXPECT_FALSE(window_->drained());
  window_->free_piece(held[0]);
  EXPECT_TRUE(window_->deliverable());
}

TEST_F(ListWindowTest, ClaimsWhatItSaysAndGivesItBack) {
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::results), ResultWindow::bytes(config()));
  window_.reset();
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::results), 0u);
}

}  // namespace
}  // namespace raymill::traversal
