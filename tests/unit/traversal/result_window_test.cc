#include "traversal/result_window.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace raymill::traversal {
namespace {

class ResultWindowTest : public testing::Test {
 protected:
  void make(std::uint32_t blocks, Field asked, Field kept, std::uint32_t most_stragglers = 0) {
    ResultWindow::Config config;
    config.asked = HitLayout(asked);
    config.kept = HitLayout(kept);
    config.chunk_shift = 4;
    config.blocks = blocks;
    config.most_stragglers = most_stragglers;
    config.spill_directory = folder_.path();
    window_ = std::move(*ResultWindow::create(config, ledger_));
    asked_ = config.asked;
  }
  // Adds a ray whose answer is its position; false where there is no room.
  bool push() {
    if (window_->room() == 0) {
      if (window_->filling()) {
        window_->close_slot();
      }
      if (!window_->begin_slot()) {
        return false;
      }
    }
    const std::uint32_t number = window_->next_number();
    Hit hit;
    hit.t = float(pushed_);
    hit.primitive_id = pushed_ + 1000;
    window_->rows().layout.write(hit, window_->rows().row(number));
    window_->add(1);
    numbers_.push_back(number);
    ++pushed_;
    return true;
  }
  void complete_all() {
    for (const std::uint32_t number : numbers_) {
      window_->complete(number);
    }
    numbers_.clear();
  }
  // Takes the next chunk, checks it, and lets it go.
  void deliver() {
    ASSERT_TRUE(window_->deliverable());
    const auto delivery = window_->deliver();
    ASSERT_TRUE(delivery);
    EXPECT_EQ(delivery->first_ray, delivered_);
    EXPECT_EQ(delivery->index, chunks_++);
    for (std::size_t i = 0; i < delivery->rows.size() / asked_.row_bytes(); ++i) {
      const Hit hit = asked_.read(delivery->rows.data() + i * asked_.row_bytes());
      EXPECT_EQ(hit.t, float(delivered_++));
    }
    window_->free_slot(delivery->slot);
  }

  storage::Ledger ledger_{mebibytes(16)};
  tests::TempFolder folder_;
  std::unique_ptr<ResultWindow> window_;
  HitLayout asked_;
  std::vector<std::uint32_t> numbers_;
  std::uint32_t pushed_ = 0, delivered_ = 0;
  std::uint64_t chunks_ = 0;
};

TEST_F(ResultWindowTest, ChunksComeInTheOrderOfTheRaysWhateverTheOrderOfTheirEnd) {
  make(8, Field::t, Field::t | Field::ids);
  for (int i = 0; i < 40; ++i) {
    ASSERT_TRUE(push());
  }
  window_->close_slot();
  EXPECT_FALSE(window_->deliverable());
  std::reverse(numbers_.begin(), numbers_.end());
  const std::uint32_t first = numbers_.back();
  numbers_.pop_back();
  complete_all();
  EXPECT_FALSE(window_->deliverable()) << "the first ray is still under way";
  window_->complete(first);
  deliver();
  deliver();
  deliver();
  EXPECT_EQ(delivered_, 40u);
  EXPECT_TRUE(window_->drained());
}

TEST_F(ResultWindowTest, LastFreeBlockIsKeptForReadingBack) {
  make(4, Field::t, Field::t);
  while (push()) {
  }
  EXPECT_EQ(pushed_, 3u * 16);
}

TEST_F(ResultWindowTest, SpilledChunksComeBackInOrderAndLeaveNoFile) {
  make(4, Field::t, Field::t | Field::ids);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    while (!push()) {
      complete_all();
      const auto spilled = window_->spill_done();
      ASSERT_TRUE(spilled);
      ASSERT_TRUE(*spilled);
    }
  }
  if (window_->filling()) {
    window_->close_slot();
  }
  complete_all();
  EXPECT_GT(window_->spilled_bytes(), 0u);
  EXPECT_EQ(window_->spilled_bytes() % 4, 0u) << "rows are spilled as they were asked for";
  EXPECT_EQ(folder_.files(), 0u) << "the file has no name";
  while (!window_->drained()) {
    ASSERT_NO_FATAL_FAILURE(deliver());
  }
  EXPECT_EQ(delivered_, 1000u);
}

TEST_F(ResultWindowTest, NothingIsSpilledThatIsNotDone) {
  make(4, Field::t, Field::t);
  while (push()) {
  }
  const auto spilled = window_->spill_done();
  ASSERT_TRUE(spilled);
  EXPECT_FALSE(*spilled);
}

TEST_F(ResultWindowTest, FolderThatIsNotThereIsAnIoErrorThatNamesIt) {
  ResultWindow::Config config;
  config.asked = config.kept = HitLayout(Field::t);
  config.chunk_shift = 4;
  config.blocks = 4;
  config.spill_directory = folder_ / "none";
  window_ = std::move(*ResultWindow::create(config, ledger_));
  while (push()) {
  }
  complete_all();
  const Status status = window_->spill_done().status();
  EXPECT_EQ(status.code(), ErrorCode::io);
  EXPECT_NE(status.message().find(config.spill_directory), std::string::npos) << status.message();
}

TEST_F(ResultWindowTest, TnearsAreZeroUntilAskedForAndAgainWhenTheSlotIsFree) {
  make(4, Field::t, Field::t);
  ASSERT_TRUE(push());
  EXPECT_EQ(window_->rows().tnear(numbers_[0]), 0);
  window_->tnears_of_filling()[0] = 2.5F;
  EXPECT_EQ(window_->rows().tnear(numbers_[0]), 2.5F);
  window_->close_slot();
  const std::uint32_t number = numbers_[0];
  complete_all();
  deliver();
  EXPECT_EQ(window_->rows().tnear(number), 0);
}

TEST_F(ResultWindowTest, ClaimsWhatItSaysAndGivesItBack) {
  make(4, Field::t, Field::all, 10);
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::results), ResultWindow::bytes(4, 4, 10, 36));
  EXPECT_GT(ResultWindow::bytes(4, 4, 10, 36), 4u * 16 * (36 + 4) + 10 * 40);
  window_.reset();
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::results), 0u);
}

// One ray of each chunk is late; its row goes on being written after the others' rows went to disk.
TEST_F(ResultWindowTest, LateRaysDoNotKeepTheirChunksInMemory) {
  make(4, Field::t | Field::primitive_id, Field::t | Field::ids, 100);
  std::vector<std::uint32_t> late;
  for (std::uint32_t i = 0; i < 40 * 16; ++i) {
    while (!push()) {
      ASSERT_TRUE(window_->short_of_blocks());
      for (const std::uint32_t number : numbers_) {
        if (number % 16 == 5) {
          late.push_back(number);
        } else {
          window_->complete(number);
        }
      }
      numbers_.clear();
      ASSERT_TRUE(window_->can_spill_open());
      ASSERT_TRUE(window_->spill_open().ok());
    }
    if (numbers_.back() % 16 == 5) {
      window_->tnears_of_filling()[5] = 0.25F;
    }
  }
  EXPECT_FALSE(window_->deliverable());
  EXPECT_GT(late.size(), 30u);
  const HitLayout kept(Field::t | Field::ids);
  for (const std::uint32_t number : late) {
    EXPECT_EQ(window_->rows().tnear(number), 0.25F);
    Hit hit = kept.read(window_->rows().row(number));
    EXPECT_EQ(hit.primitive_id, 1000 + static_cast<std::uint32_t>(hit.t));
    hit.geometry_id = 7;
    kept.write(hit, window_->rows().row(number));
    window_->complete(number);
  }
  window_->close_slot();
  complete_all();
  while (!window_->drained()) {
    ASSERT_NO_FATAL_FAILURE(deliver());
  }
  EXPECT_EQ(delivered_, 40u * 16);
}

TEST_F(ResultWindowTest, StragglersAreNoMoreThanWasClaimed) {
  make(8, Field::t, Field::t, 9);
  while (push()) {
  }
  for (const std::uint32_t number : numbers_) {
    if (number % 16 >= 4) {
      window_->complete(number);  // four of each chunk are left
    }
  }
  std::erase_if(numbers_, [](std::uint32_t number) { return number % 16 >= 4; });
  ASSERT_TRUE(window_->spill_open().ok());
  EXPECT_EQ(window_->spilled_bytes(), 2u * 16 * 4) << "two chunks with four late rays, not three";
  EXPECT_FALSE(window_->can_spill_open());
  complete_all();
  while (!window_->drained()) {
    ASSERT_NO_FATAL_FAILURE(deliver());
  }
}

// Random pushes, ends, spills and fetches against nothing but the order.
TEST_F(ResultWindowTest, AnyHistoryGivesEveryRowOnceInOrder) {
  make(6, Field::t | Field::primitive_id, Field::t | Field::ids, 40);
  tests::Random random(8);
  for (int step = 0; step < 20000; ++step) {
    switch (random.below(5)) {
      case 0:
      case 1:
        (void)push();
        break;
      case 2:
        if (!numbers_.empty()) {
          std::swap(numbers_[random.below(static_cast<std::uint32_t>(numbers_.size()))], numbers_.back());
          window_->complete(numbers_.back());
          numbers_.pop_back();
        }
        break;
      case 3:
        if (random.below(8) == 0) {
          ASSERT_TRUE(window_->spill_done());
        } else if (random.below(8) == 0) {
          ASSERT_TRUE(window_->spill_open().ok());
        }
        break;
      default:
        if (random.below(20) == 0 && window_->deliverable()) {
          ASSERT_NO_FATAL_FAILURE(deliver());
        }
    }
  }
  if (window_->filling()) {
    window_->close_slot();
  }
  complete_all();
  while (!window_->drained()) {
    ASSERT_NO_FATAL_FAILURE(deliver());
  }
  EXPECT_EQ(delivered_, pushed_);
  EXPECT_GT(pushed_, 500u);
}

}  // namespace
}  // namespace raymill::traversal
