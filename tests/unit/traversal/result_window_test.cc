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
  ResultWindow::Config config(std::uint32_t blocks, Field fields = Field::t | Field::primitive_id) const {
    return {HitLayout(fields), 4, 200, blocks, 128, folder_.path()};
  }
  void make(std::uint32_t blocks, Field fields = Field::t | Field::primitive_id) {
    layout_ = HitLayout(fields);
    window_ = std::move(*ResultWindow::create(config(blocks, fields), ledger_));
  }
  // Adds a ray; false where there is no room.
  bool push() {
    if (window_->room() == 0) {
      if (window_->filling()) {
        window_->close_slot();
      }
      if (!window_->begin_slot()) {
        return false;
      }
    }
    rays_.push_back({window_->next_number(), pushed_++});
    window_->add(1);
    return true;
  }
  // Ends a ray with its position as the answer.
  Status complete(std::size_t i) {
    std::swap(rays_[i], rays_.back());
    const auto [number, position] = rays_.back();
    rays_.pop_back();
    Hit hit;
    hit.t = float(position);
    hit.primitive_id = position + 1000;
    return window_->complete(number, hit).status();
  }
  void complete_all() {
    while (!rays_.empty()) {
      ASSERT_TRUE(complete(rays_.size() - 1).ok());
    }
  }
  void complete_chunk(std::uint32_t chunk) {
    for (std::size_t at = rays_.size(); at-- > 0;) {
      if (rays_[at].position / window_->chunk_rays() == chunk) {
        ASSERT_TRUE(complete(at).ok());
      }
    }
  }
  void close() {
    if (window_->filling()) {
      window_->close_slot();
    }
  }
  // Takes the next chunk and checks it; its slot is the caller's to free.
  std::uint32_t fetch() {
    EXPECT_TRUE(window_->deliverable());
    ResultWindow::Delivery delivery = window_->begin_delivery();
    EXPECT_TRUE(window_->collect(delivery).ok());
    window_->end_delivery(delivery);
    EXPECT_EQ(delivery.first_ray, delivered_);
    EXPECT_EQ(delivery.index, chunks_++);
    for (std::size_t i = 0; i < delivery.rows.size() / layout_.row_bytes(); ++i) {
      const Hit hit = layout_.read(delivery.rows.data() + i * layout_.row_bytes());
      EXPECT_EQ(hit.t, float(delivered_));
      EXPECT_EQ(hit.primitive_id, 1000 + delivered_++);
    }
    return delivery.slot;
  }
  void fetch_all() {
    while (!window_->drained() && !testing::Test::HasFailure()) {
      window_->free_slot(fetch());
    }
  }

  struct Pushed {
    std::uint32_t number, position;
  };
  storage::Ledger ledger_{mebibytes(16)};
  tests::TempFolder folder_;
  std::unique_ptr<ResultWindow> window_;
  HitLayout layout_;
  std::vector<Pushed> rays_;
  std::uint32_t pushed_ = 0, delivered_ = 0;
  std::uint64_t chunks_ = 0;
};

TEST_F(ResultWindowTest, EntriesOfManyRaysJoinThoseThatCameOneByOne) {
  for (const std::uint32_t blocks : {50U, 3U}) {  // in memory; most of them on disk
    make(blocks);
    rays_.clear();
    pushed_ = delivered_ = 0;
    chunks_ = 0;
    while (pushed_ < 3 * window_->chunk_rays() && push()) {
    }
    close();
    ASSERT_EQ(pushed_, 3 * window_->chunk_rays());
    const std::size_t entry_bytes = window_->entry_bytes();
    for (std::uint32_t chunk = 0; chunk < 3; ++chunk) {
      const std::uint32_t first = chunk * window_->chunk_rays();
      // The first ray alone, the others together, the last of them first.
      std::vector<std::byte> entries;
      for (std::uint32_t i = window_->chunk_rays() - 1; i > 0; --i) {
        Hit hit;
        hit.t = float(first + i);
        hit.primitive_id = first + i + 1000;
        entries.resize(entries.size() + entry_bytes);
        window_->write_entry(rays_[first + i].number, hit, entries.data() + entries.size() - entry_bytes);
      }
      Hit hit;
      hit.t = float(first);
      hit.primitive_id = first + 1000;
      EXPECT_FALSE(*window_->complete(rays_[first].number, hit));
      EXPECT_TRUE(*window_->complete_all(rays_[first + 1].number, entries)) << "the chunk is done";
    }
    fetch_all();
    EXPECT_EQ(delivered_, pushed_);
    EXPECT_EQ(window_->spilled_bytes() > 0, blocks == 3);
  }
}

TEST_F(ResultWindowTest, ChunksComeInTheOrderOfTheRaysWhateverTheOrderOfTheirEnd) {
  make(50);
  for (int i = 0; i < 40; ++i) {
    ASSERT_TRUE(push());
  }
  close();
  EXPECT_FALSE(window_->deliverable());
  while (rays_.size() > 1) {
    ASSERT_TRUE(complete(1).ok());
  }
  EXPECT_FALSE(window_->deliverable()) << "the first ray is still under way";
  ASSERT_TRUE(complete(0).ok());
  fetch_all();
  EXPECT_EQ(delivered_, 40u);
  EXPECT_EQ(window_->spilled_bytes(), 0u);
}

TEST_F(ResultWindowTest, RowsThatFindNoBlockComeBackFromDiskAndLeaveNoFile) {
  make(ResultWindow::kMinBlocks);
  tests::Random random(3);
  for (std::uint32_t i = 0; i < 1000; ++i) {
    while (!push()) {
      ASSERT_TRUE(complete(0).ok());
    }
    if (random.below(2) == 0) {
      ASSERT_TRUE(complete(random.below(static_cast<std::uint32_t>(rays_.size()))).ok());
    }
  }
  close();
  complete_all();
  EXPECT_GT(window_->spilled_bytes(), 0u);
  EXPECT_EQ(folder_.files(), 0u) << "the file has no name";
  fetch_all();
  EXPECT_EQ(delivered_, 1000u);
}

TEST_F(ResultWindowTest, SlotsEndWhenNobodyFetches) {
  make(50);
  while (push()) {
    ASSERT_TRUE(complete(0).ok());
  }
  EXPECT_EQ(pushed_, 200u * 16);
  window_->free_slot(fetch());
  EXPECT_TRUE(push());
}

TEST_F(ResultWindowTest, AsManyChunksAreUnderWayAsThereAreBlocks) {
  make(8);
  while (push()) {
  }
  EXPECT_EQ(pushed_, 8u * 16);
  EXPECT_FALSE(window_->can_begin());
  complete_chunk(3);
  EXPECT_TRUE(window_->can_begin());
  EXPECT_FALSE(window_->can_begin_many()) << "a quarter of eight is two";
  complete_chunk(5);
  EXPECT_TRUE(window_->can_begin_many());
  EXPECT_TRUE(push()) << "the fourth chunk is done";
}

// Whatever the order of the ends, what goes to disk is full blocks: 11 rows of 10 bytes in each of 128.
TEST_F(ResultWindowTest, OnlyFullBlocksGoToDisk) {
  make(20);
  tests::Random random(9);
  for (int step = 0; step < 5000; ++step) {
    while (!push()) {
      ASSERT_TRUE(complete(random.below(static_cast<std::uint32_t>(rays_.size()))).ok());
      if (window_->deliverable()) {
        window_->free_slot(fetch());
      }
    }
  }
  EXPECT_GT(window_->spilled_bytes(), 0u);
  EXPECT_LE(window_->spilled_bytes(), 5000u / 16 * 2 * 128) << "a chunk of 16 rows has two blocks";
}

TEST_F(ResultWindowTest, CallersHoldAFewChunksAtOnce) {
  make(50);
  for (std::uint32_t i = 0; i < (ResultWindow::kMostHeld + 1) * 16; ++i) {
    ASSERT_TRUE(push());
  }
  close();
  complete_all();
  std::uint32_t held = 0;
  for (std::uint32_t i = 0; i < ResultWindow::kMostHeld; ++i) {
    held = fetch();
  }
  EXPECT_FALSE(window_->deliverable());
  window_->free_slot(held);
  EXPECT_TRUE(window_->deliverable());
}

TEST_F(ResultWindowTest, FolderThatIsNotThereIsAnIoErrorThatNamesIt) {
  ResultWindow::Config config = this->config(ResultWindow::kMinBlocks);
  config.spill_directory = folder_ / "none";
  window_ = std::move(*ResultWindow::create(config, ledger_));
  Status status;
  while (status.ok() && pushed_ < 100) {
    status = push() ? Status() : complete(0);
  }
  EXPECT_EQ(status.code(), ErrorCode::io);
  EXPECT_NE(status.message().find(config.spill_directory), std::string::npos) << status.message();
}

TEST_F(ResultWindowTest, ClaimsWhatItSaysAndGivesItBack) {
  make(40);
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::results), ResultWindow::bytes(config(40)));
  EXPECT_GT(ResultWindow::bytes(config(40)), 40u * 128 + ResultWindow::kMostHeld * 16 * 8);
  window_.reset();
  EXPECT_EQ(ledger_.used_bytes(storage::Tag::results), 0u);
}

// Random pushes, ends and fetches against nothing but the order.
TEST_F(ResultWindowTest, AnyHistoryGivesEveryRowOnceInOrder) {
  for (const std::uint32_t blocks : {ResultWindow::kMinBlocks, 7u, 60u}) {
    make(blocks);
    pushed_ = delivered_ = 0;
    chunks_ = 0;
    tests::Random random(blocks);
    for (int step = 0; step < 20000; ++step) {
      const std::uint32_t dice = random.below(20);
      if (dice < 10) {
        (void)push();
      } else if (dice < 19 && !rays_.empty()) {
        ASSERT_TRUE(complete(random.below(static_cast<std::uint32_t>(rays_.size()))).ok());
      } else if (window_->deliverable()) {
        window_->free_slot(fetch());
      }
    }
    close();
    complete_all();
    fetch_all();
    EXPECT_EQ(delivered_, pushed_);
    EXPECT_GT(pushed_, 3000u);
  }
}

}  // namespace
}  // namespace raymill::traversal
