// UringReader: a PageReader by io_uring. Thread-safe.
//
//   start()   --> requests ------+--(eventfd)--> the ring's thread --reads--> kernel
//   release() --> free buffers --+                      ^                       |
//                                      done() <---------+------completions------+
//
// The ring belongs to that one thread: submitting takes no lock, no thread that traces is interrupted by a completion,
// and one that ends takes no reads with it (the kernel cancels what an ending thread has submitted). A read that the
// ring cannot do is done again by StoreFile::read_page, which falls back to buffered reads and has the messages.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "storage/io/page_reader.h"
#include "storage/io/read_buffers.h"

namespace raymill::storage {

class UringReader final : public PageReader {
 public:
  /// Whether the kernel lets this process have a ring. Errors: unsupported.
  static Status available();
  /// Claims its buffers and its ring (Tag::io). Errors: budget_exceeded, unsupported.
  static Result<std::unique_ptr<UringReader>> create(std::shared_ptr<const StoreFile> file, unsigned depth,
                                                     Ledger& ledger, ReadDone done);
  static std::uint64_t bytes(const StoreFile& file, unsigned depth);
  ~UringReader() override;

  [[nodiscard]] unsigned depth() const override { return depth_; }
  void start(PageId page) override;
  void release(const PageArrival& arrival) override;
  [[nodiscard]] std::uint64_t reads() const override { return reads_.load(std::memory_order_relaxed); }
  [[nodiscard]] std::string_view name() const override {
    return file_->direct() ? "io_uring/direct" : "io_uring/buffered";
  }

 private:
  class Ring;
  UringReader(std::shared_ptr<const StoreFile> file, unsigned depth, ReadDone done);
  void work();
  // Submits requests; false when there is nothing left to wait for.
  bool take_requests();
  void complete(const PageRun& run, int result);
  void wake();

  std::shared_ptr<const StoreFile> file_;
  const unsigned depth_;
  ReadDone done_;
  BudgetReservation reservation_;
  std::unique_ptr<Ring> ring_;
  unsigned in_flight_ = 0;  // used by the ring's thread alone
  std::atomic<std::uint64_t> reads_{0};

  std::mutex mutex_;              // guards what follows
  std::vector<PageId> requests_;  // first in, first out
  ReadBuffers buffers_;
  bool woken_ = false;  // the eventfd is written and the ring's thread has not looked since
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace raymill::storage
