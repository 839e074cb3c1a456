// StoreFileWriter: writes a store file front to back; the file gets its name when everything is in it. Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "storage/base/atomic_file.h"
#include "storage/base/status.h"
#include "storage/base/types.h"
#include "storage/pages/store_format.h"

namespace raymill::storage {

class StoreFileWriter {
 public:
  /// Errors: those of AtomicFile.
  static Result<StoreFileWriter> create(const std::string& path, StoreHeader header);

  /// Appends a page. Pages may come in any order; in the end every id below the largest must have come once.
  Status add_page(PageId page, std::span<const std::byte> encoded, std::uint32_t decoded_bytes);
  /// Writes metadata, directory and footer and commits. The caller fills what describes the scene; offsets, counts of
  /// pages and bytes, and checksums are filled here.
  Status finish(StoreFooter footer, const std::string& metadata_json);

  [[nodiscard]] std::uint64_t written_bytes() const { return file_.written_bytes(); }
  [[nodiscard]] std::uint64_t page_count() const { return directory_.size(); }
  [[nodiscard]] std::uint64_t decoded_bytes() const { return decoded_bytes_; }

 private:
  StoreFileWriter(AtomicFile file, const StoreHeader& header) : file_(std::move(file)), header_(header) {}
  AtomicFile file_;
  StoreHeader header_;
  std::vector<PageEntry> directory_;
  std::uint64_t decoded_bytes_ = 0;
  std::uint32_t max_encoded_bytes_ = 0;
};

}  // namespace raymill::storage
