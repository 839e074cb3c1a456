// ReadBuffers: where encoded pages are read to, and which pages are read at once.
//
//   requests: 7 8 9 4  -->  run 7 8 9, a read of 3 pages  -->  arrivals 7, 8, 9  -->  released one by one
//                           run 4
//
// Pages that stand one after the other in the file come by one read, into buffers that lie beside each other; those are
// free again when the last of the pages is released. Thread-compatible under the reader's lock but bytes_of(),
// run_in() and arrivals(), which need none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/io/page_reader.h"

namespace raymill::storage {

/// A read under way.
struct PageRun {
  PageId first = kNoPage;
  unsigned pages = 0;
  PageBlocks blocks;  ///< of all
  unsigned buffer = 0;
  unsigned buffers = 0;
};

class ReadBuffers {
 public:
  /// Pages that one read brings, at most.
  static constexpr unsigned kMostRunPages = 8;

  ReadBuffers(const StoreFile& file, unsigned count);
  static std::uint64_t bytes(const StoreFile& file, unsigned count) {
    return count * (file.read_buffer_bytes() + sizeof(PageRun) + sizeof(PageArrival));
  }

  /// Takes the oldest request and those after it that go on where it ends, as far as buffers are free; none: no
  /// request or no buffer.
  std::optional<PageRun> take(std::vector<PageId>& requests);
  /// The run that begins in this buffer; as long as none of its pages was released, no lock is needed.
  [[nodiscard]] const PageRun& run_in(unsigned buffer) const { return holders_[buffer]; }
  /// A page of the run that began in this buffer is needed no more.
  void release(unsigned buffer);

  [[nodiscard]] std::span<std::byte> memory() { return memory_; }
  [[nodiscard]] std::span<std::byte> bytes_of(const PageRun& run) {
    return std::span(memory_).subspan(run.buffer * buffer_bytes_, run.blocks.bytes);
  }
  /// The pages of a run of which `bytes_read` came; what is missing is read again, page by page.
  [[nodiscard]] std::vector<PageArrival> arrivals(const PageRun& run, std::uint64_t bytes_read);

 private:
  [[nodiscard]] unsigned buffers_for(std::uint64_t bytes) const {
    return static_cast<unsigned>((bytes + buffer_bytes_ - 1) / buffer_bytes_);
  }
  [[nodiscard]] unsigned free_from(unsigned buffer) const;

  const StoreFile& file_;
  const std::uint64_t buffer_bytes_;
  std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>> memory_;
  std::vector<bool> taken_;       // [buffer]
  std::vector<PageRun> holders_;  // [first buffer]: pages not yet released
};

}  // namespace raymill::storage
