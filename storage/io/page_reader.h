// PageReader: asynchronous reads of whole pages. The thread that asks never waits.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string_view>
#include <thread>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/io/store_file.h"

namespace raymill::storage {

/// A finished read. The buffer is on loan: give it back by release().
struct PageArrival {
  PageId page = kNoPage;
  unsigned buffer = 0;
  Status status;
  std::span<const std::byte> encoded;
};

/// Interface, so that a simulation can stand in for the disk. Thread-safe.
class PageReader {
 public:
  virtual ~PageReader() = default;
  /// Reads that may be under way at once, arrivals that were not released included.
  [[nodiscard]] virtual unsigned depth() const = 0;
  /// Starts a read; the caller keeps within depth().
  virtual void start(PageId page) = 0;
  virtual void release(const PageArrival& arrival) = 0;
  /// "pread-pool/direct": for statistics.
  [[nodiscard]] virtual std::string_view name() const = 0;
};

/// A pool of threads in pread(). FACTS: as fast as io_uring in MB/s, and there where containers forbid that.
class PreadPool final : public PageReader {
 public:
  using Done = std::function<void(PageArrival)>;  ///< called from a pool thread; must not block

  /// Claims its buffers (Tag::io). Errors: budget_exceeded.
  static Result<std::unique_ptr<PreadPool>> create(std::shared_ptr<const StoreFile> file, unsigned depth,
                                                   Ledger& ledger, Done done);
  static std::uint64_t buffer_bytes(const StoreFile& file, unsigned depth) { return file.read_buffer_bytes() * depth; }
  ~PreadPool() override;

  [[nodiscard]] unsigned depth() const override { return depth_; }
  void start(PageId page) override;
  void release(const PageArrival& arrival) override;
  [[nodiscard]] std::string_view name() const override {
    return file_->direct() ? "pread-pool/direct" : "pread-pool/buffered";
  }

 private:
  PreadPool(std::shared_ptr<const StoreFile> file, unsigned depth, Done done);
  void work();

  std::shared_ptr<const StoreFile> file_;
  const unsigned depth_;
  Done done_;
  BudgetReservation reservation_;
  std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>> memory_;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<PageId> requests_;  // first in, first out
  std::vector<unsigned> free_buffers_;
  bool stopping_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace raymill::storage
