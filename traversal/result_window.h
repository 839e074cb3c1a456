// ResultWindow: the rows of the rays in flight, chunk by chunk, and their way out in the rays' order.
//
//   slot: free -> filling (push) -> tracing -> done -> held by a HitChunk -> free
//   rows: in a block of memory, or in a temporary file from which they come back when the chunk's turn comes
//
// A ray's number is slot << chunk_shift | position, so a kernel finds its row without a look-up. Two kinds of chunk
// give their block up to the next rays when memory is short: those that are done while nobody fetches them, and those
// of which a few rays are left, which wait for pages that hardly any ray wants. The rows of these stragglers stay in
// memory; the others' go to an unlinked temporary file. So neither pushing everything first nor one late ray needs more
// memory. Thread-compatible: the owner's lock guards everything but the rows and tnears of chunks under way, which
// belong to whoever has the ray.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/mapped_memory.h"
#include "storage/base/status.h"
#include "traversal/query.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

class ResultWindow {
 public:
  struct Config {
    HitLayout asked;  ///< what the caller gets
    HitLayout kept;   ///< what a row holds while its ray is in flight; at least `asked`
    unsigned chunk_shift = 0;
    std::uint32_t blocks = 0;  ///< chunks whose rows are in memory; at least kMinBlocks
    /// Rays whose chunks have given their block up, at most.
    std::uint32_t most_stragglers = 0;
    std::string spill_directory;
  };
  static constexpr std::uint32_t kMinBlocks = 4;
  /// Chunks under way or waiting for each block: how far new rays may be ahead of the oldest. Numbers must fit 32 bits.
  static constexpr std::uint32_t kSlotsPerBlock = 64;

  /// Claims rows and tnears (Tag::results). Errors: budget_exceeded.
  static Result<std::unique_ptr<ResultWindow>> create(const Config& config, storage::Ledger& ledger);
  static std::uint64_t bytes(unsigned chunk_shift, std::uint32_t blocks, std::uint32_t most_stragglers,
                             std::size_t kept_row_bytes);
  ~ResultWindow();

  [[nodiscard]] const RowTable& rows() const { return table_; }
  [[nodiscard]] std::uint32_t chunk_rays() const { return 1U << config_.chunk_shift; }

  // Filling. One slot at a time.

  /// Room in the slot being filled; 0 when there is none.
  [[nodiscard]] std::uint32_t room() const;
  /// Begins a slot if one may be taken; the last free block is kept for reading back.
  bool begin_slot();
  /// Whether begin_slot() fails for want of a block, which spilling can change.
  [[nodiscard]] bool short_of_blocks() const { return free_blocks_.size() < 2; }
  /// The number of the next ray of the slot being filled, and that `rays` are added to it.
  [[nodiscard]] std::uint32_t next_number() const;
  void add(std::uint32_t rays);
  /// The slot being filled takes no more.
  void close_slot();
  /// Values for the slot being filled; all zero when first asked for.
  float* tnears_of_filling();

  /// A ray is done with its row. True: its chunk is done with it.
  bool complete(std::uint32_t number);

  // Delivery.

  struct Delivery {
    std::uint64_t index = 0;
    std::uint64_t first_ray = 0;
    std::span<std::byte> rows;  ///< in the asked layout
    std::uint32_t slot = 0;
  };
  /// Whether the next chunk in order can be taken.
  [[nodiscard]] bool deliverable() const;
  /// Whether all chunks were taken (more may follow).
  [[nodiscard]] bool drained() const { return order_.empty(); }
  /// Takes the next chunk; deliverable() must hold. Errors: io (reading back).
  Result<Delivery> deliver();
  void free_slot(std::uint32_t slot);

  // Spilling.

  /// Writes one finished chunk to the temporary file to free its block; false when none can go. Errors: io, disk_full.
  Result<bool> spill_done();
  /// Whether spill_open() would find a chunk of which few rays are left.
  [[nodiscard]] bool can_spill_open() const { return find_open().has_value(); }
  /// Writes such chunks until half of the blocks are free or none is left. No ray of the job may be in anyone's hands.
  /// Errors: io, disk_full.
  Status spill_open();
  [[nodiscard]] std::uint64_t spilled_bytes() const { return spilled_bytes_; }
  [[nodiscard]] bool filling() const { return filling_ != kNone; }

 private:
  static constexpr std::uint32_t kNone = 0xFFFFFFFFu;
  enum class State : std::uint8_t { free, filling, tracing, done, held };
  struct Slot {
    State state = State::free;
    std::uint32_t rays = 0;
    std::uint32_t remaining = 0;  ///< rays under way
    std::uint32_t block = kNone;  ///< none: the rows are in the file
    std::uint64_t first_ray = 0;
    std::uint32_t place = kNone;  ///< in the file, counted in whole chunks
    std::unique_ptr<float[]> tnears;
    std::vector<bool> done;  ///< [chunk_rays], while there is a block
    std::unique_ptr<StragglerRows> stragglers;
  };

  explicit ResultWindow(const Config& config);
  [[nodiscard]] std::optional<std::uint32_t> find_open() const;
  StragglerRows take_stragglers(const Slot& slot, const std::byte* rows) const;
  void compact(std::byte* rows, std::uint32_t count) const;
  Status write_rows(Slot& slot);
  Status merge_stragglers(Slot& slot) const;
  Status write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
  Status read_at(std::uint64_t offset, std::span<std::byte> bytes) const;
  void give_up_block(std::uint32_t slot);
  [[nodiscard]] std::uint64_t file_offset(const Slot& slot) const {
    return (std::uint64_t(slot.place) << config_.chunk_shift) * config_.asked.row_bytes();
  }
  [[nodiscard]] std::byte* block_rows(std::uint32_t block) const {
    return memory_.data() + (std::size_t(block) << config_.chunk_shift) * config_.kept.row_bytes();
  }
  Status open_file();

  const Config config_;
  storage::BudgetReservation reservation_;
  storage::MappedMemory memory_;
  RowTable table_;
  std::vector<Slot> slots_;
  std::vector<std::byte*> bases_;
  std::vector<StragglerRows*> stragglers_;
  std::vector<const float*> tnears_;
  std::vector<std::uint32_t> free_slots_, free_blocks_, free_places_;
  std::uint32_t filling_ = kNone;
  std::deque<std::uint32_t> order_;  // slots of chunks not yet delivered
  std::uint32_t straggler_count_ =
      0;  // rows of stragglers whose chunks are not done; those of done ones are merged first
  std::uint64_t next_index_ = 0;
  std::uint64_t next_ray_ = 0;
  int file_ = -1;
  std::uint32_t places_ = 0;  // of the file so far
  std::uint64_t spilled_bytes_ = 0;
};

}  // namespace raymill::traversal
