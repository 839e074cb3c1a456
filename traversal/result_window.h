// ResultWindow: the rows of the rays in flight, chunk by chunk, and their way out in the rays' order.
//
//   slot: free -> filling (push) -> tracing -> done -> held by a HitChunk -> free
//                                                \--> spilled to a temporary file -> read back when its turn comes
//
// There are as many slots as the budget allows. A ray's number is slot << chunk_shift | position, so a kernel finds its
// row without a look-up. When push() needs a slot and the caller does not fetch results, finished chunks go to an
// unlinked temporary file, so that pushing everything first needs no more memory.
// Thread-compatible: the owner's lock guards everything but the rows and tnears of chunks under way, which belong to
// whoever has the ray.
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
    std::uint32_t slots = 0;  ///< at least kMinSlots
    std::string spill_directory;
  };
  static constexpr std::uint32_t kMinSlots = 4;

  /// Claims rows and tnears (Tag::results). Errors: budget_exceeded.
  static Result<std::unique_ptr<ResultWindow>> create(const Config& config, storage::Ledger& ledger);
  static std::uint64_t bytes(const Config& config);
  ~ResultWindow();

  [[nodiscard]] const RowTable& rows() const { return table_; }
  [[nodiscard]] std::uint32_t chunk_rays() const { return 1U << config_.chunk_shift; }

  // Filling. One slot at a time.

  /// Room in the slot being filled; 0 when there is none.
  [[nodiscard]] std::uint32_t room() const;
  /// Begins a slot if one may be taken; the last free slot is kept for reading back.
  bool begin_slot();
  /// The number of the next ray of the slot being filled, and that `rays` are added to it.
  [[nodiscard]] std::uint32_t next_number() const;
  void add(std::uint32_t rays);
  /// The slot being filled takes no more.
  void close_slot();
  /// Values for the slot being filled; all zero when first asked for.
  float* tnears_of_filling();

  /// A ray is done with its row.
  void complete(std::uint32_t number);

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

  /// Writes one finished chunk to the temporary file to free its slot; false when none can go. Errors: io, disk_full.
  Result<bool> spill();
  [[nodiscard]] std::uint64_t spilled_bytes() const { return spilled_bytes_; }
  [[nodiscard]] bool filling() const { return filling_ != kNoSlot; }

 private:
  static constexpr std::uint32_t kNoSlot = 0xFFFFFFFFu;
  enum class State : std::uint8_t { free, filling, tracing, done, held };
  struct Slot {
    State state = State::free;
    std::uint32_t rays = 0;
    std::uint32_t remaining = 0;
    std::unique_ptr<float[]> tnears;
  };
  struct Chunk {
    std::uint64_t first_ray = 0;
    std::uint32_t rays = 0;
    std::uint32_t slot = kNoSlot;  // kNoSlot: in the file
    std::uint64_t file_offset = 0;
  };

  explicit ResultWindow(const Config& config);
  [[nodiscard]] std::optional<std::uint32_t> find_free() const;
  [[nodiscard]] std::uint32_t free_count() const;
  void compact(std::uint32_t slot, std::uint32_t rays);
  Status open_file();

  const Config config_;
  storage::BudgetReservation reservation_;
  storage::MappedMemory memory_;
  RowTable table_;
  std::vector<Slot> slots_;
  std::vector<const float*> tnears_;
  std::uint32_t filling_ = kNoSlot;
  std::deque<Chunk> order_;  // chunks not yet delivered
  std::uint64_t next_index_ = 0;
  std::uint64_t next_ray_ = 0;
  int file_ = -1;
  std::uint64_t file_end_ = 0;
  std::uint64_t spilled_bytes_ = 0;
};

}  // namespace raymill::traversal
