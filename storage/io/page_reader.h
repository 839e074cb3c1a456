// PageReader: asynchronous reads of whole pages. The thread that asks never waits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/io/store_file.h"

namespace raymill::storage {

/// A page that was read. The buffer is on loan: give it back by release().
struct PageArrival {
  PageId page = kNoPage;
  unsigned buffer = 0;
  Status status;
  std::span<const std::byte> encoded;
};

/// Takes a finished read. Called from a thread of the reader; must not block. It may call start() and release().
using ReadDone = std::function<void(PageArrival)>;

/// Interface, so that a simulation can stand in for the disk. Thread-safe.
class PageReader {
 public:
  /// Waits for the reads that are under way; those that were not begun are dropped without an arrival.
  virtual ~PageReader() = default;
  /// Pages that may be under way at once, arrivals that were not released included.
  [[nodiscard]] virtual unsigned depth() const = 0;
  /// Starts a read; the caller keeps within depth().
  virtual void start(PageId page) = 0;
  virtual void release(const PageArrival& arrival) = 0;
  /// Reads that the system was asked for: pages that follow each other in the file come by one.
  [[nodiscard]] virtual std::uint64_t reads() const = 0;
  /// "io_uring/direct", "pread-pool/buffered": for statistics.
  [[nodiscard]] virtual std::string_view name() const = 0;
};

/// automatic: io_uring where the kernel lets this process have it, else the pool.
enum class ReaderKind : std::uint8_t { automatic, uring, pread };
/// "auto", "uring", "pread"; empty is auto. Errors: invalid_argument for another name, and for "uring" where there is
/// none: containers often forbid it.
Result<ReaderKind> parse_reader_kind(std::string_view name);

/// Errors: budget_exceeded, unsupported (io_uring asked for where there is none).
Result<std::unique_ptr<PageReader>> make_page_reader(std::shared_ptr<const StoreFile> file, ReaderKind kind,
                                                     unsigned depth, Ledger& ledger, ReadDone done);
/// The most that a reader of any kind claims.
std::uint64_t page_reader_bytes(const StoreFile& file, unsigned depth);
/// Threads that a reader has, at most, whatever its depth.
constexpr unsigned kMostReaderThreads = 8;

}  // namespace raymill::storage
