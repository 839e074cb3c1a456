// PageTrace: which pages a run's rays entered, and which were read and evicted, in a file. Public.
//
// tests/bench/out_of_core/raymill-belady computes from it how few reads the same requests could have done with.
//
//   header   "RMPGTRC1", u32 page_count, u32 frame_count
//   events   u32 each: kind in bits 30 and 31, page below     0 batch   rays that waited at the page run on
//                                                             1 enter   the batch before entered this page too
//                                                             2 read    the page came in
//                                                             3 evict   the page went
//
// Little-endian, written as they come; nothing grows with the run. A batch and the pages it entered are written while
// its worker still pins them, so each of them has a frame at that moment. Pages of a batch are in rising order, not in
// that of its rays. Thread-safe.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "storage/base/status.h"

namespace raymill {

class PageTrace {
 public:
  enum class Event : std::uint32_t { batch = 0, enter = 1, read = 2, evict = 3 };
  static constexpr unsigned kKindShift = 30;
  static constexpr char kMagic[9] = "RMPGTRC1";

  /// Errors: those of a file that cannot be written.
  static Result<std::shared_ptr<PageTrace>> create(const std::string& path);
  ~PageTrace();
  PageTrace(const PageTrace&) = delete;
  PageTrace& operator=(const PageTrace&) = delete;

  /// The store that is recorded. Errors: unsupported (a second store, or one with 2^30 pages).
  Status begin(std::uint32_t page_count, std::uint32_t frame_count);
  void add(Event event, std::uint32_t page);

  /// What one worker's batches enter.
  class Lane;

  /// Gives the file its name; later events are lost. The first error of the whole run: disk_full, io.
  Status finish();

 private:
  class Impl;
  explicit PageTrace(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Thread-confined.
class PageTrace::Lane {
 public:
  Lane(std::shared_ptr<PageTrace> trace, std::uint32_t page_count)
      : trace_(std::move(trace)),
        page_count_(page_count),
        marks_(new std::atomic<std::uint8_t>[marks_of(page_count)]()) {
    entered_.reserve(page_count);
  }
  static std::uint64_t bytes(std::uint32_t page_count) {
    return marks_of(page_count) + page_count * sizeof(std::uint32_t);
  }

  /// Where a kernel marks the pages that it enters: [page_count].
  [[nodiscard]] std::atomic<std::uint8_t>* marks() const { return marks_.get(); }
  /// Writes the batch and passes its marks on to `touched`.
  void end_batch(std::uint32_t page, std::atomic<std::uint8_t>* touched);

 private:
  static constexpr std::uint32_t marks_of(std::uint32_t page_count) { return (page_count + 7) / 8 * 8; }

  const std::shared_ptr<PageTrace> trace_;
  const std::uint32_t page_count_;
  const std::unique_ptr<std::atomic<std::uint8_t>[]> marks_;
  std::vector<std::uint32_t> entered_;
};

}  // namespace raymill
