// ByteWindow: a file from front to back, through a buffer. An error ends the bytes and is kept. Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/import/byte_source.h"

namespace raymill::storage {

class ByteWindow {
 public:
  static constexpr std::size_t kBytes = 256 << 10;  // of the buffer
  static constexpr std::size_t kMostPeek = 64 << 10;

  /// `file` outlives the window.
  ByteWindow(const ByteSource& file, std::uint64_t offset) : file_(&file), buffer_(kBytes), read_to_(offset) {}

  /// The bytes that come next: at least `least` (up to kMostPeek), fewer only at the end of the file or after an error.
  /// Valid until the next peek.
  std::span<const std::byte> peek(std::size_t least) {
    if (end_ - begin_ < least) {
      refill(least);
    }
    return std::span(buffer_).subspan(begin_, end_ - begin_);
  }
  /// Goes past `count` bytes that peek() has shown.
  void take(std::size_t count) { begin_ += count; }
  /// Goes past `count` bytes without reading them; false where the file ends before.
  bool skip(std::uint64_t count);

  /// Where in the file the next byte stands.
  [[nodiscard]] std::uint64_t offset() const { return read_to_ - (end_ - begin_); }
  /// The first error of a read.
  [[nodiscard]] const Status& status() const { return status_; }

 private:
  void refill(std::size_t least);

  const ByteSource* file_;
  std::vector<std::byte> buffer_;
  std::uint64_t read_to_;
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  Status status_;
};

}  // namespace raymill::storage
