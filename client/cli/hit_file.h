// HitFile: where trace's rows go.
//
//   plain:   a temporary name, renamed when whole (AtomicFile): after any other end nothing is left
//   resumed: OUT.part beside the output, and OUT.part.json, which says what run it belongs to; a run that is stopped,
//   also
//            by kill -9, leaves them, and the next one with the same rays, store and question goes on after the last
//            whole row
//
// Rows come in the rays' order, so the length of the file says how far the run came. Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>

#include "storage/base/atomic_file.h"
#include "storage/base/status.h"

namespace raymill::client {

class HitFile {
 public:
  /// Errors: those of AtomicFile.
  static Result<HitFile> create(const std::string& path, const std::string& header);
  /// `run`: what the rows depend on; a part of another run is refused (invalid_argument). Errors: busy_retry (another
  /// process writes the part), io, disk_full, not_found.
  static Result<HitFile> resume(const std::string& path, const std::string& header, std::size_t row_bytes,
                                const nlohmann::json& run);
  HitFile(HitFile&& other) noexcept;
  HitFile& operator=(HitFile&&) = delete;
  ~HitFile();

  /// Rows that an earlier run has written.
  [[nodiscard]] std::uint64_t rows_done() const { return rows_done_; }
  Status write(std::span<const std::byte> rows);
  /// The output gets its name.
  Status commit();

 private:
  explicit HitFile(std::string path) : path_(std::move(path)) {}
  Status open_part(const std::string& header, std::size_t row_bytes);

  std::string path_;
  std::optional<storage::AtomicFile> whole_;
  int part_ = -1;
  std::uint64_t part_bytes_ = 0;
  std::uint64_t rows_done_ = 0;
};

}  // namespace raymill::client
