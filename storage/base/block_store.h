// BlockStore: blocks of one size that stay in memory as long as they may and go to a temporary file after that.
//
// The file has no name from the moment it is made (O_TMPFILE, else unlinked at once), so nothing of it outlives the
// process, however that ends. Freed blocks are used again, so the file is as large as what it holds at its fullest.
// Threads: write(), release(), and read() of blocks that are not being released may run anywhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"

namespace raymill::storage {

/// Large enough for a disk that seeks, small enough that a thousand are open at once.
constexpr std::size_t kBlockBytes = 64 << 10;

enum class BlockId : std::uint32_t {};

class BlockStore {
 public:
  /// `folder`: where the temporary file is made when it is first needed.
  BlockStore(Ledger& ledger, std::string folder) : ledger_(ledger), folder_(std::move(folder)) {}
  BlockStore(const BlockStore&) = delete;
  BlockStore& operator=(const BlockStore&) = delete;
  ~BlockStore();

  /// Blocks are kept in memory only while this much of the budget stays free.
  void keep_free(std::uint64_t bytes) { keep_free_bytes_ = bytes; }

  /// Stores at most kBlockBytes. Errors: disk_full, io.
  Result<BlockId> write(std::span<const std::byte> bytes);
  /// Fills `out` from the block's bytes at `offset_in_block` on. Errors: io.
  Status read(BlockId block, std::span<std::byte> out, std::size_t offset_in_block = 0) const;
  void release(BlockId block);

  /// Of the temporary file at its largest.
  [[nodiscard]] std::uint64_t file_bytes() const { return std::uint64_t(file_blocks_) * kBlockBytes; }
  [[nodiscard]] std::uint64_t memory_bytes() const { return slabs_.size() * kSlabBlocks * kBlockBytes; }
  [[nodiscard]] const std::string& folder() const { return folder_; }

 private:
  static constexpr std::uint32_t kSlabBlocks = 64;
  static constexpr std::uint32_t kInFile = 1u << 31;
  static constexpr std::uint32_t kMostBlocks = kInFile - 1;

  struct Slab {
    BudgetReservation claim;
    MappedMemory memory;
  };
  struct Place {
    std::uint32_t number = 0;     // in memory or in the file
    std::byte* memory = nullptr;  // null: in the file
  };
  Result<Place> new_place();
  bool add_slab();
  Status open_file();
  [[nodiscard]] std::byte* in_memory(std::uint32_t block) const {
    return slabs_[block / kSlabBlocks].memory.data() + std::size_t(block % kSlabBlocks) * kBlockBytes;
  }

  Ledger& ledger_;
  const std::string folder_;
  std::uint64_t keep_free_bytes_ = 0;
  mutable std::mutex mutex_;
  std::vector<Slab> slabs_;
  std::vector<std::uint32_t> free_memory_, free_file_;
  std::uint32_t file_blocks_ = 0;
  int descriptor_ = -1;
};

}  // namespace raymill::storage
