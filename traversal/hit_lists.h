// HitLists: the hits of a chunk's rays, as workers found them in any order, sorted and cut into pieces for the caller.
//
//   blocks of entries --take()--> area --sort--> pieces                       where the area holds all of them
//                                  |               ^
//                                  +-- sorted run --+-- merge --> pieces      where it does not: runs on disk
//                                        ^     |
//                                        +-----+ merged into longer runs, kMostRuns at a time
//
// So memory is the area's whatever a ray hits, and each hit is written once, and once more for each time that there are
// kMostRuns times as many. Hits come by ray, then t, then geometry id, then primitive id: the same bytes whatever the
// order in which they came. Thread-confined but for pieces, which belong to the owner's lock.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "traversal/query.h"
#include "traversal/row_block.h"
#include "traversal/spill_file.h"

namespace raymill::traversal {

class HitLists {
 public:
  struct Config {
    Field asked = kDefaultClosestFields;
    std::uint64_t first = 0;       ///< of each ray so many hits; 0: all
    std::size_t block_bytes = 0;   ///< of blocks of entries with rows of kept(asked)
    std::uint32_t chunk_rays = 0;  ///< at most
    std::size_t sort_bytes = 0;
    std::size_t piece_bytes = 0;
    std::uint32_t pieces = 0;  ///< that callers may hold at once
    std::string directory;
  };
  static constexpr std::uint32_t kMostRuns = 64;

  /// What sorting needs of a hit, whatever was asked for.
  static constexpr Field kept(Field asked) { return asked | Field::t | Field::ids; }
  static std::uint64_t bytes(const Config& config);

  explicit HitLists(const Config& config);
  /// Whether the system had the address space.
  [[nodiscard]] bool ok() const { return area_.data() != nullptr && pieces_.data() != nullptr; }

  /// Rows of rays that follow each other.
  struct Piece {
    std::uint32_t number = 0;
    std::uint32_t first_position = 0;
    std::span<const std::uint32_t> offsets;  ///< one more than rays
    std::span<const std::byte> rows;
    bool goes_on = false;  ///< the last ray has more
    bool is_last = false;  ///< of its chunk
  };

  // By the owner's lock:
  [[nodiscard]] bool has_piece() const { return !free_pieces_.empty(); }
  std::uint32_t take_piece();
  void give_piece(std::uint32_t piece) { free_pieces_.push_back(piece); }

  // A chunk: begin(), take() for each of its blocks, fill() until a piece is the last.
  void begin(std::uint32_t rays);
  /// Errors: io, disk_full, checksum_mismatch.
  Status take(const std::byte* block);
  Status fill(Piece& piece);

  [[nodiscard]] std::uint64_t spilled_bytes() const { return spilled_bytes_; }

 private:
  struct Item {
    std::uint64_t key;  // by which items are sorted, first of all
    const std::byte* entry;
  };
  /// A run while it is merged.
  struct Cursor {
    std::byte* block = nullptr;
    std::uint32_t row = 0;
  };
  class RunWriter;
  class FirstOnes;

  static std::uint64_t key_of(const std::byte* entry);
  [[nodiscard]] PrimitiveIds ids_of(const std::byte* entry) const;
  [[nodiscard]] const std::byte* entry_at(std::uint32_t cursor) const;
  [[nodiscard]] bool comes_after(std::uint32_t a, std::uint32_t b) const;
  void sort_items();
  Status keep_run();
  Status add_run(std::size_t level, std::uint32_t run);
  Result<std::uint32_t> merge(std::span<const std::uint32_t> runs);
  Status begin_merge(std::span<const std::uint32_t> runs);
  Status read_block(std::uint32_t place, std::byte* block);
  Status begin_reading();
  [[nodiscard]] const std::byte* next_entry() const;
  Status advance();
  void write_row(const std::byte* entry, std::byte* row) const;

  const Config config_;
  const HitLayout kept_, asked_;
  const std::size_t entry_bytes_, ids_at_;
  const std::uint32_t most_items_;
  storage::MappedMemory area_;  // items, entries, a block that is written
  storage::MappedMemory pieces_;
  std::vector<std::uint32_t> free_pieces_;
  Item* items_ = nullptr;
  std::byte* entries_ = nullptr;
  std::byte* out_ = nullptr;
  std::uint32_t most_cursors_ = 0;

  std::uint32_t rays_ = 0;   // of the chunk
  std::uint32_t ray_ = 0;    // that is given
  std::uint64_t given_ = 0;  // hits of that ray so far
  std::uint32_t item_count_ = 0, next_item_ = 0;
  bool is_reading_ = false;
  bool is_merging_ = false;
  std::vector<std::vector<std::uint32_t>> runs_;  // first places, by how often they were merged
  std::vector<Cursor> cursors_;
  std::vector<std::uint32_t> heap_;  // cursors, the next entry's first
  SpillFile file_;
  std::uint64_t spilled_bytes_ = 0;
};

}  // namespace raymill::traversal
