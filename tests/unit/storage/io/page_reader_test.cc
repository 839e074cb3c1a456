#include "storage/io/page_reader.h"

#include <gtest/gtest.h>
#include <sys/mount.h>

#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <set>
#include <thread>

#include "storage/io/uring_reader.h"
#include "tests/support/stores.h"

namespace raymill::storage {
namespace {

using tests::Random;

// The same for every kind of reader.
class PageReaderTest : public testing::TestWithParam<ReaderKind> {
 protected:
  void SetUp() override {
    if (const Status status = UringReader::available(); GetParam() == ReaderKind::uring && !status.ok()) {
      // Kernels and containers may forbid io_uring; then the pread pool is what runs there too.
      GTEST_SKIP() << status.message();
    }
    open(folder_.path());
  }
  void open(const std::string& folder) {
    if (path_.empty()) {
      Random random(1);
      path_ = tests::build_store(folder_, "scene.mill", {tests::soup(random, 4000)});
    }
    if (folder != folder_.path()) {
      std::filesystem::copy_file(path_, folder + "/scene.mill");
    }
    file_ = *StoreFile::open(folder + "/scene.mill", ledger_);
    ASSERT_GT(file_->page_count(), 4u);
  }
  std::unique_ptr<PageReader> reader(unsigned depth) {
    return std::move(*make_page_reader(file_, GetParam(), depth, ledger_, [this](PageArrival arrival) {
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
  // Reads all pages, `depth` at once.
  void read_all(PageReader& reader) {
    std::set<std::uint32_t> seen;
    std::uint32_t started = 0;
    unsigned under_way = 0;
    while (seen.size() < file_->page_count()) {
      for (; started < file_->page_count() && under_way < reader.depth(); ++started, ++under_way) {
        reader.start(PageId{started});
      }
      const PageArrival arrival = wait();
      ASSERT_TRUE(arrival.status.ok()) << arrival.status.message();
      EXPECT_TRUE(file_->check_page(arrival.page, arrival.encoded).ok());
      EXPECT_TRUE(seen.insert(index_of(arrival.page)).second);
      reader.release(arrival);
      --under_way;
    }
  }

  tests::TempFolder folder_;
  Ledger ledger_{gibibytes(1)};
  std::string path_;
  std::shared_ptr<const StoreFile> file_;
  std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<PageArrival> arrivals_;
};

INSTANTIATE_TEST_SUITE_P(Kinds, PageReaderTest, testing::Values(ReaderKind::uring, ReaderKind::pread),
                         [](const auto& test) { return test.param == ReaderKind::uring ? "uring" : "pread"; });

TEST_P(PageReaderTest, EveryPageArrivesWithItsBytes) {
  for (const unsigned depth : {1u, 3u, 64u}) {
    const auto all = reader(depth);
    EXPECT_EQ(all->depth(), depth);
    read_all(*all);
  }
}

TEST_P(PageReaderTest, NamesItsKind) {
  const std::string kind = GetParam() == ReaderKind::uring ? "io_uring/" : "pread-pool/";
  EXPECT_EQ(reader(1)->name(), kind + (file_->direct() ? "direct" : "buffered"));
}

TEST_P(PageReaderTest, ManyThreadsAskAtOnce) {
  constexpr unsigned kThreads = 4, kRounds = 50;
  const auto shared = reader(8);
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < kThreads; ++i) {
    threads.emplace_back([&, i] {
      for (unsigned round = 0; round < kRounds; ++round) {
        shared->start(PageId{(i * kRounds + round) % file_->page_count()});
      }
    });  // a thread that ends takes no reads with it
  }
  for (unsigned i = 0; i < kThreads * kRounds; ++i) {
    const PageArrival arrival = wait();
    EXPECT_TRUE(arrival.status.ok() && file_->check_page(arrival.page, arrival.encoded).ok());
    shared->release(arrival);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

TEST_P(PageReaderTest, BuffersOnLoanAreNotOverwritten) {
  const auto two = reader(2);
  two->start(PageId{0});
  const PageArrival first = wait();
  for (std::uint32_t page = 1; page < file_->page_count(); ++page) {
    two->start(PageId{page});
    const PageArrival other = wait();
    EXPECT_NE(other.buffer, first.buffer);
    two->release(other);
  }
  EXPECT_TRUE(file_->check_page(first.page, first.encoded).ok());
  two->release(first);
}

TEST_P(PageReaderTest, RequestWaitsForABufferThatComesBack) {
  const auto one = reader(1);
  one->start(PageId{0});
  one->start(PageId{1});
  const PageArrival first = wait();
  one->release(first);
  const PageArrival second = wait();
  EXPECT_TRUE(file_->check_page(PageId{1}, second.encoded).ok());
  one->release(second);
}

TEST_P(PageReaderTest, DoneMayAskForTheNextPage) {
  std::mutex mutex;
  std::condition_variable changed;
  std::uint32_t done = 0;
  PageReader* self = nullptr;
  auto chain = std::move(*make_page_reader(file_, GetParam(), 2, ledger_, [&](PageArrival arrival) {
    const std::lock_guard lock(mutex);
    self->release(arrival);
    if (++done < file_->page_count()) {
      self->start(PageId{done});
    }
    changed.notify_all();
  }));
  std::unique_lock lock(mutex);
  self = chain.get();
  self->start(PageId{0});
  changed.wait(lock, [&] { return done == file_->page_count(); });
}

TEST_P(PageReaderTest, FileThatWasCutShortIsAnIoErrorNotAHang) {
  const PageId last{file_->page_count() - 1};
  // Before the page, within it and within one of its blocks.
  for (const std::uint64_t size : {std::uint64_t(100), file_->entry(last).offset + 1, file_->entry(last).offset}) {
    std::filesystem::resize_file(path_, size);
    const auto two = reader(2);
    two->start(last);
    const PageArrival arrival = wait();
    EXPECT_EQ(arrival.status.code(), ErrorCode::io);
    EXPECT_NE(arrival.status.message().find("cut short"), std::string::npos) << arrival.status.message();
    two->release(arrival);
  }
}

TEST_P(PageReaderTest, PageInTheFilesLastBlockIsRead) {
  const PageId last{file_->page_count() - 1};
  std::filesystem::resize_file(path_, file_->entry(last).offset + file_->entry(last).encoded_bytes);
  read_all(*reader(2));
}

TEST_P(PageReaderTest, EndsWhileReadsAreUnderWay) {
  for (unsigned i = 0; i < 50; ++i) {
    const auto four = reader(4);
    for (std::uint32_t page = 0; page < i % 8; ++page) {  // also more than there are buffers
      four->start(PageId{page % file_->page_count()});
    }
  }
}

TEST_P(PageReaderTest, ClaimsItsBuffers) {
  const auto two = reader(2);
  EXPECT_GE(ledger_.used_bytes(Tag::io), 2 * file_->read_buffer_bytes());
  EXPECT_LE(ledger_.used_bytes(Tag::io), page_reader_bytes(*file_, 2));
  Ledger small(100);
  EXPECT_EQ(make_page_reader(file_, GetParam(), 2, small, [](const PageArrival&) {}).status().code(),
            ErrorCode::budget_exceeded);
}

// A ramfs knows no direct reads.
TEST_P(PageReaderTest, RefusedDirectReadsAreBufferedAndToldOf) {
  EXPECT_EQ(file_->io_note().empty(), file_->direct());
  const std::string folder = folder_ / "ramfs";
  std::filesystem::create_directory(folder);
  if (::mount("ramfs", folder.c_str(), "ramfs", 0, nullptr) != 0) {
    // Mounting takes root, which a container may not have.
    GTEST_SKIP() << "cannot mount a ramfs: " << std::strerror(errno);
  }
  open(folder);
  EXPECT_FALSE(file_->direct());
  EXPECT_NE(file_->io_note().find(folder), std::string::npos) << file_->io_note();
  {
    const auto three = reader(3);
    EXPECT_TRUE(three->name().ends_with("/buffered"));
    read_all(*three);
  }
  file_.reset();
  ::umount2(folder.c_str(), MNT_DETACH);  // the kernel may hold the ring's file for a moment
}

TEST(PageReader, KindsHaveNames) {
  EXPECT_EQ(*parse_reader_kind(""), ReaderKind::automatic);
  EXPECT_EQ(*parse_reader_kind("auto"), ReaderKind::automatic);
  EXPECT_EQ(*parse_reader_kind("pread"), ReaderKind::pread);
  EXPECT_EQ(parse_reader_kind("uring").ok(), UringReader::available().ok());
  EXPECT_EQ(parse_reader_kind("mmap").status().code(), ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace raymill::storage
