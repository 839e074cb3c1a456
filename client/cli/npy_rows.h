// NpyRows: the rows of a .npy file, C order, as a stream: a file of any size passes through a buffer of 64 KiB.
// Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "client/cli/npy.h"
#include "storage/base/status.h"

namespace raymill::client {

class NpyRows {
 public:
  /// `what` is in the rows, for messages: "rays". Errors: not_found, io, bad_rays (not a plain file, not C order).
  static Result<NpyRows> open(const std::string& path, const std::string& what);
  NpyRows(NpyRows&& other) noexcept;
  NpyRows& operator=(NpyRows&& other) noexcept;
  ~NpyRows();

  [[nodiscard]] const NpyHeader& header() const { return header_; }
  /// The header's shape as Python writes it: (3, 6), (18,).
  [[nodiscard]] std::string shape_text() const;
  [[nodiscard]] Status bad(const std::string& why) const { return {ErrorCode::bad_rays, path_ + ": " + why}; }
  /// Says how long a row is, before the first read. Errors: bad_rays (the file is longer or shorter).
  Status begin(std::size_t row_bytes);

  [[nodiscard]] std::uint64_t count() const { return header_.shape[0]; }
  /// Leaves out the next `rows`, at most all that are left.
  void skip(std::uint64_t rows) { next_ = rows < count() - next_ ? next_ + rows : count(); }
  /// The next row is the first one again.
  void rewind() { next_ = 0; }
  /// What tells this file from another one of the same name: size and time of the last change.
  [[nodiscard]] std::string identity() const;
  /// Whole rows, at most `rows` and what the buffer holds, until the next call; empty at the end. Errors: io, bad_rays
  /// (the file shrank).
  Result<std::span<const std::byte>> read(std::size_t rows);

 private:
  NpyRows() = default;

  std::string path_, what_;
  int descriptor_ = -1;
  NpyHeader header_;
  std::uint64_t file_bytes_ = 0;
  std::size_t row_bytes_ = 0;
  std::uint64_t next_ = 0;
  std::vector<std::byte> buffer_;
};

}  // namespace raymill::client
