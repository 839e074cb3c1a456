// RowBlock: entries of a position in a chunk and a row, as they lie in memory and in temporary files. A block on disk
// carries a checksum; blocks of a chain name the next one. Plain data.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "storage/base/checksum.h"

namespace raymill::traversal {

struct RowBlock {
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  using Position = std::uint16_t;  ///< of a ray in its chunk

  std::uint32_t next = kNone;  ///< of its chain
  std::uint32_t rows = 0;
  std::uint64_t checksum = 0;  ///< of the entries, on disk

  static constexpr std::size_t entry_bytes(std::size_t row_bytes) { return sizeof(Position) + row_bytes; }
  /// Entries that a block of so many bytes has room for.
  static constexpr std::uint32_t room(std::size_t block_bytes, std::size_t row_bytes) {
    return static_cast<std::uint32_t>((block_bytes - sizeof(RowBlock)) / entry_bytes(row_bytes));
  }
  static Position position_of(const std::byte* entry) {
    Position position;
    std::memcpy(&position, entry, sizeof position);
    return position;
  }
  static const RowBlock& of(const std::byte* block) { return *reinterpret_cast<const RowBlock*>(block); }
  static const std::byte* entries(const std::byte* block) { return block + sizeof(RowBlock); }
  static std::uint64_t checksum_of(const std::byte* block, std::size_t row_bytes) {
    return storage::checksum({entries(block), of(block).rows * entry_bytes(row_bytes)});
  }
};

}  // namespace raymill::traversal
