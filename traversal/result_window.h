// ResultWindow: rows of rays that are done, and their way out in the rays' order.
//
//   chunk of rays: free -> filling (push) -> tracing -> done -> held by a HitChunk -> free
//   rows of a chunk: blocks of (position, row) in the order in which its rays ended --> sorted when its turn comes
//
// Where rays have lists of hits, a row comes for each hit when it is found, and a chunk whose turn has come is sorted
// and given piece by piece (hit_lists.h): ... done -> sorting -> free.
//
// A ray's number is slot << chunk_shift | position. A ray under way costs nothing here: a row is made when the ray is
// done. Where blocks are short they go to a temporary file, those of the latest chunks first; a chunk's blocks there
// are a chain, so nothing here grows with what is on disk. So neither pushing everything first nor a few late rays need
// more memory. A block on disk carries a checksum. Thread-compatible under the owner's lock but collect(), which needs
// none.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "traversal/hit_lists.h"
#include "traversal/query.h"
#include "traversal/row_block.h"
#include "traversal/spill_file.h"

namespace raymill::traversal {

class ResultWindow {
 public:
  struct Config {
    HitLayout layout;
    unsigned chunk_shift = 0;  ///< rays of a chunk: 2^chunk_shift, at most 2^16
    std::uint32_t slots = 0;   ///< chunks that are not yet delivered, at most
    std::uint32_t blocks = 0;  ///< in memory, and chunks under way at most; at least kMinBlocks
    std::size_t block_bytes = 0;
    std::string spill_directory;
    /// Of lists of hits; no pieces: rays have a row each. `layout` is HitLists::kept(asked) there.
    HitLists::Config lists = {};
  };
  static constexpr std::uint32_t kMinBlocks = 2;
  /// Blocks on disk, for each in memory, whose places are used again: a bit each.
  static constexpr std::uint32_t kPlacesPerBlock = 1024;
  /// Chunks that callers may hold at once.
  static constexpr std::uint32_t kMostHeld = 4;

  /// Claims all that it will use (Tag::results). Errors: budget_exceeded.
  static Result<std::unique_ptr<ResultWindow>> create(const Config& config, storage::Ledger& ledger);
  static std::uint64_t bytes(const Config& config);

  [[nodiscard]] std::uint32_t chunk_rays() const { return 1U << config_.chunk_shift; }

  // Filling. One slot at a time.

  /// Room in the slot being filled; 0 when there is none.
  [[nodiscard]] std::uint32_t room() const;
  /// Whether a slot can begin, and whether a quarter of the chunks that may be under way can.
  [[nodiscard]] bool can_begin() const { return !free_slots_.empty() && under_way_ < config_.blocks; }
  [[nodiscard]] bool can_begin_many() const { return can_begin() && under_way_ <= config_.blocks - config_.blocks / 4; }
  [[nodiscard]] bool filling() const { return filling_ != kNone; }
  /// Begins a slot; false when all are taken, or as many chunks are under way as there are blocks.
  bool begin_slot();
  /// The number of the next ray of the slot being filled, and that `rays` are added to it.
  [[nodiscard]] std::uint32_t next_number() const;
  void add(std::uint32_t rays);
  /// The slot being filled takes no more.
  void close_slot();

  /// A ray is done. True: its chunk is. Errors: io, disk_full (a block had to go to disk).
  Result<bool> complete(std::uint32_t number, const Hit& hit, const HitAttributes& attributes = kNoAttributes);
  /// Bytes of a row with its place, and such an entry made of an answer; needs no lock.
  [[nodiscard]] std::size_t entry_bytes() const { return RowBlock::entry_bytes(config_.layout.row_bytes()); }
  void write_entry(std::uint32_t number, const Hit& hit, std::byte* entry) const {
    write_entry(number, hit, kNoAttributes, entry);
  }
  void write_entry(std::uint32_t number, const Hit& hit, const HitAttributes& attributes, std::byte* entry) const;
  /// Rays of one chunk, the one that `number` is of, are done: their entries. Else as complete().
  Result<bool> complete_all(std::uint32_t number, std::span<const std::byte> entries);
  /// A hit more of a ray with a list. Errors: the same.
  Status add_hit(std::uint32_t number, const Hit& hit, const HitAttributes& attributes = kNoAttributes);
  /// So many rays with lists, of the chunk that `number` is of, have all their hits. True: all of the chunk's have.
  bool complete(std::uint32_t number, std::uint32_t rays);

  // Delivery: begin_delivery(), collect(), end_delivery(); and free_slot() when the caller has let go.

  struct Delivery {
    std::uint64_t index = 0;
    std::uint64_t first_ray = 0;
    std::span<std::byte> rows;
    std::uint32_t slot = 0;
    std::vector<std::uint32_t> places;  // that were read back
  };
  /// Whether the next chunk in order can be taken.
  [[nodiscard]] bool deliverable() const;
  /// Whether all chunks were taken (more may follow).
  [[nodiscard]] bool drained() const { return order_.empty() && sorting_.slot == kNone; }
  /// Takes the next chunk; deliverable() must hold. Its rows are there after collect().
  Delivery begin_delivery();
  /// Errors: io, checksum_mismatch.
  Status collect(Delivery& delivery);
  void end_delivery(const Delivery& delivery);
  void free_slot(std::uint32_t slot);

  // Delivery of lists: the next chunk's blocks are sorted, block by block; then its pieces come.

  [[nodiscard]] bool has_lists() const { return lists_ != nullptr; }
  /// Takes blocks of the next chunk in hand; false when all are sorted. deliverable() must hold.
  bool begin_blocks();
  /// Sorts them; needs no lock. Errors: io, disk_full, checksum_mismatch.
  Status sort_blocks();
  void end_blocks();
  /// The next piece, its rows there after fill_piece(), which needs no lock. Errors: io, checksum_mismatch.
  HitLists::Piece begin_piece();
  Status fill_piece(HitLists::Piece& piece) { return lists_->fill(piece); }
  /// Says where the piece stands: its index and its first ray.
  struct PiecePlace {
    std::uint64_t index, first_ray;
  };
  PiecePlace end_piece(const HitLists::Piece& piece);
  void free_piece(std::uint32_t piece) { lists_->give_piece(piece); }

  /// Of lists: up to the last block or piece that was ended.
  [[nodiscard]] std::uint64_t spilled_bytes() const { return spilled_bytes_ + lists_spilled_bytes_; }

 private:
  static constexpr std::uint32_t kNone = RowBlock::kNone;
  enum class State : std::uint8_t { free, filling, tracing, done, held };
  struct Slot {
    State state = State::free;
    std::uint32_t rays = 0;
    std::uint32_t remaining = 0;  // rays under way
    std::uint32_t open = kNone;   // the block being filled
    std::uint32_t full = kNone;   // first of a chain of blocks in memory
    std::uint32_t place = kNone;  // first of a chain of blocks on disk
    std::uint32_t buffer = kNone;
    std::uint64_t first_ray = 0;
  };
  using Position = RowBlock::Position;
  /// The chunk whose lists are given.
  struct Sorting {
    std::uint32_t slot = kNone;
    std::vector<std::uint32_t> blocks;  // in hand
    std::uint32_t place = kNone;        // first of a chain in hand
    std::vector<std::uint32_t> places;  // that were read back
  };

  explicit ResultWindow(const Config& config);
  [[nodiscard]] std::byte* block(std::uint32_t index) const { return blocks_.data() + index * config_.block_bytes; }
  [[nodiscard]] RowBlock& header(std::uint32_t index) const { return *reinterpret_cast<RowBlock*>(block(index)); }
  [[nodiscard]] std::uint32_t block_rows() const {
    return RowBlock::room(config_.block_bytes, config_.layout.row_bytes());
  }
  /// Blocks of a chunk that is sorted that are in hand at once: some are left to go to disk.
  [[nodiscard]] std::uint32_t most_in_hand() const { return std::max(1U, config_.blocks / 4); }
  Status open_block(Slot& slot);
  /// Places for rows in the open block, of which there is at least one.
  Result<std::uint32_t> open_rows(Slot& slot);
  void close_block(Slot& slot);
  void end_slot(Slot& slot);
  Status spill_block();
  [[nodiscard]] std::uint32_t choose_victim() const;
  Status read_block(std::uint32_t place, std::span<std::byte> block) const;
  Status place_rows(const std::byte* block, const Delivery& delivery, std::uint32_t& rows_left) const;
  Status damaged() const;

  const Config config_;
  storage::BudgetReservation reservation_;
  storage::MappedMemory blocks_, buffers_;
  std::vector<Slot> slots_;
  std::vector<std::uint32_t> free_slots_, free_blocks_, free_buffers_;
  std::uint32_t filling_ = kNone;
  std::uint32_t under_way_ = 0;      // chunks that are not done
  std::deque<std::uint32_t> order_;  // slots of chunks not yet delivered
  std::uint64_t next_index_ = 0;
  std::uint64_t next_ray_ = 0;
  SpillFile file_;
  std::uint64_t spilled_bytes_ = 0;
  std::unique_ptr<HitLists> lists_;
  std::uint64_t lists_spilled_bytes_ = 0;  // what lists_ itself says is for its thread alone
  Sorting sorting_;
};

}  // namespace raymill::traversal
