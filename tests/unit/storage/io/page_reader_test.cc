#include "storage/io/page_reader.h"

#include <gtest/gtest.h>

#include <condition_variable>
#include <filesystem>
#include <memory>
#include <mutex>
#include <set>

#include "tests/support/stores.h"

namespace raymill::storage {
namespace {

using tests::Random;

class PageReaderTest : public testing::Test {
 protected:
  PageReaderTest() {
    Random random(1);
    path_ = tests::build_store(folder_, "scene.mill", {tests::soup(random, 4000)});
    file_ = *StoreFile::open(path_, ledger_);
  }
  std::unique_ptr<PreadPool> pool(unsigned depth) {
    return std::move(*PreadPool::create(file_, depth, ledger_, [this](PageArrival arrival) {
      const std::lock_guard lock(mutex_);
      arrivals_.push_back(std::move(arrival));
      arrived_.notify_all();
    }));
  }
  PageArrival wait() {
    std::unique_lock lock(mutex_);
    arrived_.wait(lock, [this] { return !arrivals_.empty(); });
    PageArrival arrival = std::move(arrivals_.back());
    arrivals_.pop_back();
    return arrival;
  }

  tests::TempFolder folder_;
  Ledger ledger_{gibibytes(1)};
  std::string path_;
  std::shared_ptr<const StoreFile> file_;
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<PageArrival> arrivals_;
};

TEST_F(PageReaderTest, EveryPageArrivesWithItsBytes) {
  const auto reader = pool(3);
  EXPECT_EQ(reader->depth(), 3u);
  std::set<std::uint32_t> seen;
  std::uint32_t started = 0;
  unsigned under_way = 0;
  while (seen.size() < file_->page_count()) {
    for (; started < file_->page_count() && under_way < reader->depth(); ++started, ++under_way) {
      reader->start(PageId{started});
    }
    const PageArrival arrival = wait();
    EXPECT_TRUE(arrival.status.ok());
    EXPECT_TRUE(file_->check_page(arrival.page, arrival.encoded).ok());
    EXPECT_TRUE(seen.insert(index_of(arrival.page)).second);
    reader->release(arrival);
    --under_way;
  }
}

TEST_F(PageReaderTest, BuffersOnLoanAreNotOverwritten) {
  const auto reader = pool(2);
  reader->start(PageId{0});
  const PageArrival first = wait();
  for (std::uint32_t page = 1; page < file_->page_count(); ++page) {
    reader->start(PageId{page});
    const PageArrival other = wait();
    EXPECT_NE(other.buffer, first.buffer);
    reader->release(other);
  }
  EXPECT_TRUE(file_->check_page(first.page, first.encoded).ok());
  reader->release(first);
}

TEST_F(PageReaderTest, FileThatWasCutShortIsAnIoErrorNotAHang) {
  std::filesystem::resize_file(path_, 100);
  const auto reader = pool(2);
  reader->start(PageId{file_->page_count() - 1});
  const PageArrival arrival = wait();
  EXPECT_EQ(arrival.status.code(), ErrorCode::io);
  EXPECT_NE(arrival.status.message().find("cut short"), std::string::npos) << arrival.status.message();
  reader->release(arrival);
}

TEST_F(PageReaderTest, EndsWhileReadsAreUnderWay) {
  for (int i = 0; i < 20; ++i) {
    const auto reader = pool(4);
    for (std::uint32_t page = 0; page < 4; ++page) {
      reader->start(PageId{page});
    }
  }
}

TEST_F(PageReaderTest, ClaimsItsBuffers) {
  const auto reader = pool(2);
  EXPECT_EQ(ledger_.used_bytes(Tag::io), 2 * file_->read_buffer_bytes());
  Ledger small(100);
  EXPECT_EQ(PreadPool::create(file_, 2, small, [](const PageArrival&) {}).status().code(), ErrorCode::budget_exceeded);
}

}  // namespace
}  // namespace raymill::storage
