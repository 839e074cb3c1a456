// AtomicFile: a file that is there whole or not at all.
//
// Bytes go to a temporary name beside the target (NAME.PID-N.tmp) and the file is renamed by commit(); destruction
// without commit() removes the temporary. A target that is a symbolic link is replaced where it points to. A target
// that exists and is not a plain file (a device, a pipe) is written directly: there is nothing to rename.
//
// A killed process leaves its temporary. The next create() of the same target removes it: a temporary is locked (flock)
// from its first moment to its last, so one that can be locked has no writer. Where the file system has no locks
// nothing is removed; where locks do not reach other machines, two of them must not write one target at a time.
// Thread-compatible; pwrite() of ranges that do not overlap may run in several threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "storage/base/status.h"

namespace raymill::storage {

class AtomicFile {
 public:
  /// Opens the temporary and removes abandoned ones of the same target. Errors: invalid_argument (a directory),
  /// not_found (no such folder), disk_full, io.
  static Result<AtomicFile> create(const std::string& path);

  AtomicFile(AtomicFile&& other) noexcept { swap(other); }
  AtomicFile& operator=(AtomicFile&& other) noexcept {
    AtomicFile(std::move(other)).swap(*this);
    return *this;
  }
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  ~AtomicFile();

  /// Appends after the last write(). Errors: disk_full, io.
  Status write(std::span<const std::byte> bytes);
  /// Writes at `offset`; leaves the place of write() alone. Errors: disk_full, io.
  Status pwrite(std::span<const std::byte> bytes, std::uint64_t offset);
  /// Closes the file and gives it its name; nothing may be written after. Errors: disk_full, io.
  Status commit();

  [[nodiscard]] const std::string& path() const { return path_; }
  /// Where the bytes are until commit(); equal to path() where the target is written directly.
  [[nodiscard]] const std::string& temporary_path() const { return temporary_path_; }
  [[nodiscard]] std::uint64_t written_bytes() const { return written_bytes_; }  ///< by write()
  [[nodiscard]] int descriptor() const { return descriptor_; }

 private:
  AtomicFile() = default;
  Status close_and_rename();
  void swap(AtomicFile& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(temporary_path_, other.temporary_path_);
    std::swap(descriptor_, other.descriptor_);
    std::swap(written_bytes_, other.written_bytes_);
  }

  std::string path_;
  std::string temporary_path_;
  int descriptor_ = -1;
  std::uint64_t written_bytes_ = 0;
};

}  // namespace raymill::storage
