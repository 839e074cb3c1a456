// RowFile: rows of one size in a temporary file without a name, written once in order, then read in order by as many
// readers as are wanted. It holds one buffer of kRows rows, each reader another. Appending is thread-confined; readers
// may run in threads of their own.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "storage/base/status.h"
#include "traversal/spill_file.h"

namespace raymill::client {

template <typename Row>
class RowFile {
  static_assert(std::is_trivially_copyable_v<Row>);

 public:
  static constexpr std::size_t kRows = 4096;

  /// `folder`: empty for TMPDIR, else /tmp. `what`: "rays", for messages.
  RowFile(std::string folder, std::string what)
      : file_({.directory = std::move(folder), .what = std::move(what), .place_bytes = kRows * sizeof(Row)}) {
    buffer_.reserve(kRows);
  }

  /// Errors: io, disk_full.
  Status append(const Row& row) {
    buffer_.push_back(row);
    ++count_;
    return buffer_.size() == kRows ? flush() : Status();
  }
  /// Ends the writing. Errors: io, disk_full.
  Status finish() { return buffer_.empty() ? Status() : flush(); }
  [[nodiscard]] std::uint64_t count() const { return count_; }

  class Reader {
   public:
    explicit Reader(const RowFile& file) : file_(file), buffer_(kRows) {}
    /// The next row is the first one again.
    void rewind() { next_ = 0; }
    /// The next rows, at most `most`, valid until the next call; none at the end. Errors: io.
    Result<std::span<const Row>> next(std::size_t most) {
      const std::uint64_t place = next_ / kRows;
      const std::size_t first = next_ % kRows;
      const auto held = static_cast<std::size_t>(std::min<std::uint64_t>(kRows, file_.count_ - place * kRows));
      if (first == 0 && held > 0) {
        const auto bytes = std::as_writable_bytes(std::span(buffer_).first(held));
        RAYMILL_RETURN_IF_ERROR(file_.file_.read(static_cast<std::uint32_t>(place), bytes));
      }
      const std::size_t count = std::min(most, held - first);
      next_ += count;
      return std::span<const Row>(buffer_).subspan(first, count);
    }

   private:
    const RowFile& file_;
    std::vector<Row> buffer_;
    std::uint64_t next_ = 0;
  };

 private:
  Status flush() {
    const Status status = file_.write(file_.take(), std::as_writable_bytes(std::span(buffer_)));
    buffer_.clear();
    return status;
  }

  traversal::SpillFile file_;
  std::vector<Row> buffer_;
  std::uint64_t count_ = 0;
};

}  // namespace raymill::client
