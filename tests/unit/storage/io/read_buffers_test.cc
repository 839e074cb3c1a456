#include "storage/io/read_buffers.h"

#include <gtest/gtest.h>

#include "tests/support/stores.h"

namespace raymill::storage {
namespace {

class ReadBuffersTest : public testing::Test {
 protected:
  ReadBuffersTest() {
    tests::Random random(3);
    const std::string path = tests::build_store(folder_, "scene.mill", {tests::soup(random, 20000)});
    file_ = *StoreFile::open(path, ledger_);
  }
  static std::vector<PageId> pages(std::initializer_list<std::uint32_t> numbers) {
    std::vector<PageId> pages;
    for (const std::uint32_t number : numbers) {
      pages.push_back(PageId{number});
    }
    return pages;
  }
  // Reads the run and checks each page.
  std::vector<PageArrival> read(ReadBuffers& buffers, const PageRun& run) const {
    std::vector<PageArrival> arrivals = buffers.arrivals(run, file_->read_blocks(run.blocks, buffers.bytes_of(run)));
    EXPECT_EQ(arrivals.size(), run.pages);
    for (std::uint32_t i = 0; i < arrivals.size(); ++i) {
      EXPECT_EQ(index_of(arrivals[i].page), index_of(run.first) + i);
      EXPECT_TRUE(arrivals[i].status.ok());
      EXPECT_TRUE(file_->check_page(arrivals[i].page, arrivals[i].encoded).ok());
    }
    return arrivals;
  }

  tests::TempFolder folder_;
  Ledger ledger_{gibibytes(1)};
  std::shared_ptr<const StoreFile> file_;
};

TEST_F(ReadBuffersTest, PagesThatFollowEachOtherComeByOneRead) {
  ASSERT_GT(file_->page_count(), 20u);
  ReadBuffers buffers(*file_, 16);
  std::vector<PageId> requests = pages({3, 4, 5, 9, 8, 2});
  const std::pair<std::uint32_t, unsigned> runs[] = {{3, 3}, {9, 1}, {8, 1}, {2, 1}};
  for (const auto& [first, count] : runs) {
    const auto run = buffers.take(requests);
    ASSERT_TRUE(run);
    EXPECT_EQ(index_of(run->first), first);
    EXPECT_EQ(run->pages, count);
    read(buffers, *run);
  }
  EXPECT_FALSE(buffers.take(requests));
}

TEST_F(ReadBuffersTest, RunHasNoMorePagesThanItMay) {
  ReadBuffers buffers(*file_, 64);
  std::vector<PageId> requests;
  for (std::uint32_t i = 0; i < 20; ++i) {
    requests.push_back(PageId{i});
  }
  for (const unsigned count : {8u, 8u, 4u}) {
    const auto run = buffers.take(requests);
    ASSERT_TRUE(run);
    EXPECT_EQ(run->pages, count);
    read(buffers, *run);
  }
}

TEST_F(ReadBuffersTest, BuffersAreFreeWhenTheLastPageIsReleased) {
  ReadBuffers buffers(*file_, 2);
  std::vector<PageId> requests = pages({0, 1, 7, 9});
  const auto run = buffers.take(requests);
  ASSERT_TRUE(run);
  ASSERT_EQ(run->pages, 2u);
  std::vector<PageArrival> arrivals = read(buffers, *run);
  const auto other = buffers.take(requests);
  EXPECT_EQ(other.has_value(), run->buffers == 1);
  buffers.release(arrivals[0].buffer);
  if (!other) {
    EXPECT_FALSE(buffers.take(requests)) << "page 1 is still there";
  }
  EXPECT_TRUE(file_->check_page(PageId{1}, arrivals[1].encoded).ok());
  buffers.release(arrivals[1].buffer);
  EXPECT_TRUE(buffers.take(requests));
}

TEST_F(ReadBuffersTest, PagesThatDidNotComeAreReadAgain) {
  ReadBuffers buffers(*file_, 8);
  std::vector<PageId> requests = pages({0, 1, 2});
  const auto run = buffers.take(requests);
  ASSERT_TRUE(run);
  for (const PageArrival& arrival : buffers.arrivals(*run, 0)) {
    EXPECT_TRUE(arrival.status.ok());
    EXPECT_TRUE(file_->check_page(arrival.page, arrival.encoded).ok());
  }
}

}  // namespace
}  // namespace raymill::storage
