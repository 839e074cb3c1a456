// SpillFile: what does not fit in memory for now, in a temporary file that nobody sees.
//
// The file is made when it is first needed and has no name, so nothing of it outlives the process. It is divided into
// places of one size; freed places are used again, the first in the file first. Reads and writes may run beside each
// other and beside take() and give(), which belong to the owner's lock. Thread-compatible.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill::traversal {

class SpillFile {
 public:
  struct Config {
    std::string directory;
    std::string what;  ///< "results": for messages
    std::size_t place_bytes = 0;
    /// Places that are used again when they were freed; those beyond go back to the file system, which takes longer.
    std::uint32_t remembered_places = 0;
    /// Past the page cache where the file system allows. Buffers are then aligned to kAlignment, with room up to the
    /// next multiple of it.
    bool direct = false;
  };
  static constexpr std::size_t kAlignment = 4096;
  static constexpr std::uint64_t table_bytes(std::uint32_t remembered_places) { return words(remembered_places) * 8; }

  explicit SpillFile(Config config);
  SpillFile(const SpillFile&) = delete;
  SpillFile& operator=(const SpillFile&) = delete;
  ~SpillFile();

  [[nodiscard]] std::uint32_t take();
  void give(std::uint32_t place);

  /// At the place's beginning, at most place_bytes. Errors: io, disk_full.
  Status write(std::uint32_t place, std::span<std::byte> bytes);
  /// Errors: io.
  Status read(std::uint32_t place, std::span<std::byte> bytes) const;

  [[nodiscard]] std::uint64_t file_bytes() const { return std::uint64_t(places_) * config_.place_bytes; }

 private:
  static constexpr std::uint64_t words(std::uint32_t places) { return (std::uint64_t(places) + 63) / 64; }
  Status open();
  [[nodiscard]] std::size_t whole(std::size_t bytes) const;

  const Config config_;
  std::mutex opening_;
  int descriptor_ = -1;
  bool direct_ = false;
  std::vector<std::uint64_t> free_;  // bit for each remembered place
  std::size_t first_word_ = 0;       // those before it have no bit set
  std::uint32_t places_ = 0;
};

}  // namespace raymill::traversal
