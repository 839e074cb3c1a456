// Lists on the wire: a chunk of lists cut into frames, and a frame read back. A frame is offsets, then rows.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::server {

/// Cuts a chunk of lists into parts whose frames have at most so many bytes: between rays where it can, else in the
/// middle of one. The chunk must outlive it. Thread-confined.
class ListCutter {
 public:
  /// `most_bytes`: room for an offset, one more and a row at least.
  ListCutter(const HitChunk& chunk, std::size_t most_bytes)
      : chunk_(chunk), offsets_(chunk.offsets()), row_bytes_(chunk.layout().row_bytes()), most_bytes_(most_bytes) {}

  /// On to the next part; false when there is none.
  bool next() {
    first_ += rays_ - (cut_ ? 1 : 0);
    first_row_ += rows_;
    rays_ = rows_ = 0;
    cut_ = false;
    const std::size_t all = offsets_.size() - 1;
    while (first_ + rays_ < all && !cut_) {
      const std::size_t free = most_bytes_ - (rays_ + 2) * sizeof(std::uint32_t) - rows_ * row_bytes_;
      const std::size_t wanted = offsets_[first_ + rays_ + 1] - first_row_ - rows_;
      const bool room = most_bytes_ >= (rays_ + 2) * sizeof(std::uint32_t) + rows_ * row_bytes_;
      if (!room || (wanted * row_bytes_ > free && rays_ > 0)) {
        break;
      }
      cut_ = wanted * row_bytes_ > free;
      rows_ += std::min(wanted, free / row_bytes_);
      ++rays_;
    }
    return rays_ > 0;
  }
  [[nodiscard]] std::size_t first() const { return first_; }  ///< ray of the chunk
  [[nodiscard]] std::size_t rays() const { return rays_; }
  [[nodiscard]] std::size_t rows() const { return rows_; }
  /// The last ray has more rows, in the next part or the next chunk.
  [[nodiscard]] bool goes_on() const { return cut_ || (chunk_.goes_on() && first_ + rays_ == offsets_.size() - 1); }
  [[nodiscard]] std::size_t bytes() const { return (rays_ + 1) * sizeof(std::uint32_t) + rows_ * row_bytes_; }
  /// Writes bytes() bytes.
  void write(std::span<std::byte> frame) const {
    std::byte* at = frame.data();
    for (std::size_t i = 0; i <= rays_; ++i, at += sizeof(std::uint32_t)) {
      const auto offset = static_cast<std::uint32_t>(
          std::clamp<std::size_t>(offsets_[first_ + i], first_row_, first_row_ + rows_) - first_row_);
      std::memcpy(at, &offset, sizeof offset);
    }
    const auto rows = chunk_.rows().subspan(first_row_ * row_bytes_, rows_ * row_bytes_);
    std::copy(rows.begin(), rows.end(), at);
  }

 private:
  const HitChunk& chunk_;
  const std::span<const std::uint32_t> offsets_;
  const std::size_t row_bytes_, most_bytes_;
  std::size_t first_ = 0, rays_ = 0;
  std::size_t first_row_ = 0, rows_ = 0;
  bool cut_ = false;  // the last ray of the part has more in the next one
};

/// The offsets of a frame of lists, checked: from 0 on, never falling, to `rows`; and its size. Errors: corrupt.
Result<std::vector<std::uint32_t>> read_offsets(std::span<const std::byte> frame, std::uint64_t rays,
                                                std::uint64_t rows, std::size_t row_bytes);

}  // namespace raymill::server
