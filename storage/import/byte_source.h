// ByteSource: the bytes of a regular file or of a span, read by range.
//
// Files are read with pread and never mapped: pages of a mapping would count as resident beyond what the ledger knows,
// and a file that shrinks while it is read would end the process instead of the import. Thread-compatible.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>

#include "storage/base/status.h"

namespace raymill::storage {

class ByteSource {
 public:
  ByteSource() = default;
  /// Opens a regular file. Errors: not_found, io.
  static Result<ByteSource> open(const std::string& path);
  /// Reads from `bytes`, which must outlive the source.
  static ByteSource view(std::span<const std::byte> bytes);

  ByteSource(ByteSource&& other) noexcept { swap(other); }
  ByteSource& operator=(ByteSource&& other) noexcept {
    ByteSource(std::move(other)).swap(*this);
    return *this;
  }
  ByteSource(const ByteSource&) = delete;  // two owners would close the file twice
  ByteSource& operator=(const ByteSource&) = delete;
  ~ByteSource();

  [[nodiscard]] std::uint64_t size_bytes() const { return size_bytes_; }
  /// Fills `out` from `offset`. Errors: io (also where the file has become shorter), bad_scene (past the end).
  Status read(std::uint64_t offset, std::span<std::byte> out) const;

 private:
  void swap(ByteSource& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    std::swap(bytes_, other.bytes_);
    std::swap(size_bytes_, other.size_bytes_);
  }
  int descriptor_ = -1;
  std::span<const std::byte> bytes_;
  std::uint64_t size_bytes_ = 0;
};

}  // namespace raymill::storage
