#include "traversal/result_window.h"

#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <utility>

#include "storage/base/file_io.h"

namespace raymill::traversal {
namespace {

// A chunk gives its block up when at most one in so many of its rays is left.
constexpr std::uint32_t kOpenShare = 2;
constexpr std::size_t kMergeBytes = 64 << 10;

}  // namespace

std::uint64_t ResultWindow::bytes(unsigned chunk_shift, std::uint32_t blocks, std::uint32_t most_stragglers,
                                  std::size_t kept_row_bytes) {
  const std::uint64_t chunk_rays = std::uint64_t(1) << chunk_shift;
  const std::uint64_t slots = std::uint64_t(blocks) * kSlotsPerBlock;
  return blocks * chunk_rays * (kept_row_bytes + sizeof(float)) +
         most_stragglers * (kept_row_bytes + sizeof(float) + sizeof(std::uint32_t)) + blocks * chunk_rays / 8 +
         slots * (sizeof(Slot) + sizeof(StragglerRows) + 5 * sizeof(void*));
}

Result<std::unique_ptr<ResultWindow>> ResultWindow::create(const Config& config, storage::Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(storage::BudgetReservation reservation,
                           ledger.claim(storage::Tag::results, bytes(config.chunk_shift, config.blocks,
                                                                     config.most_stragglers, config.kept.row_bytes())));
  std::unique_ptr<ResultWindow> window(new ResultWindow(config));
  if (window->memory_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for the results in flight"};
  }
  window->reservation_ = std::move(reservation);
  return window;
}

ResultWindow::ResultWindow(const Config& config)
    : config_(config),
      memory_((std::uint64_t(config.blocks) << config.chunk_shift) * config.kept.row_bytes()),
      slots_(std::size_t(config.blocks) * kSlotsPerBlock),
      bases_(slots_.size(), nullptr),
      stragglers_(slots_.size(), nullptr),
      tnears_(slots_.size(), nullptr) {
  assert(config.blocks >= kMinBlocks);
  assert(std::uint64_t(slots_.size()) << config.chunk_shift <= 0xFFFFFFFFu);
  table_ = {config.chunk_shift, config.kept.row_bytes(), config.kept,
            bases_.data(),      stragglers_.data(),      tnears_.data()};
  for (std::uint32_t slot = static_cast<std::uint32_t>(slots_.size()); slot-- > 0;) {
    free_slots_.push_back(slot);
  }
  for (std::uint32_t block = config.blocks; block-- > 0;) {
    free_blocks_.push_back(block);
  }
}

ResultWindow::~ResultWindow() {
  if (file_ >= 0) {
    ::close(file_);
  }
}

std::uint32_t ResultWindow::room() const { return filling_ == kNone ? 0 : chunk_rays() - slots_[filling_].rays; }

bool ResultWindow::begin_slot() {
  assert(filling_ == kNone);
  if (free_blocks_.size() < 2 || free_slots_.empty()) {
    return false;
  }
  filling_ = free_slots_.back();
  free_slots_.pop_back();
  Slot& slot = slots_[filling_];
  slot.state = State::filling;
  slot.rays = 0;
  slot.remaining = 0;
  slot.first_ray = next_ray_;
  slot.block = free_blocks_.back();
  free_blocks_.pop_back();
  slot.done.assign(chunk_rays(), false);
  bases_[filling_] = block_rows(slot.block);
  order_.push_back(filling_);
  return true;
}

std::uint32_t ResultWindow::next_number() const { return (filling_ << config_.chunk_shift) + slots_[filling_].rays; }

void ResultWindow::add(std::uint32_t rays) {
  slots_[filling_].rays += rays;
  slots_[filling_].remaining += rays;
  next_ray_ += rays;
}

void ResultWindow::close_slot() {
  Slot& slot = slots_[filling_];
  if (slot.rays == 0) {
    order_.pop_back();
    free_slot(filling_);
  } else {
    slot.state = slot.remaining == 0 ? State::done : State::tracing;
  }
  filling_ = kNone;
}

float* ResultWindow::tnears_of_filling() {
  Slot& slot = slots_[filling_];
  if (!slot.tnears) {
    slot.tnears = std::make_unique<float[]>(chunk_rays());
    tnears_[filling_] = slot.tnears.get();
  }
  return slot.tnears.get();
}

bool ResultWindow::complete(std::uint32_t number) {
  Slot& slot = slots_[number >> config_.chunk_shift];
  if (!slot.stragglers) {
    slot.done[number & (chunk_rays() - 1)] = true;
  }
  if (--slot.remaining > 0 || slot.state != State::tracing) {
    return false;
  }
  slot.state = State::done;
  straggler_count_ -= slot.stragglers ? static_cast<std::uint32_t>(slot.stragglers->positions.size()) : 0;
  return true;
}

bool ResultWindow::deliverable() const {
  if (order_.empty()) {
    return false;
  }
  const Slot& slot = slots_[order_.front()];
  return slot.state == State::done && (slot.block != kNone || !free_blocks_.empty());
}

Result<ResultWindow::Delivery> ResultWindow::deliver() {
  const std::uint32_t index = order_.front();
  Slot& slot = slots_[index];
  const bool in_file = slot.block == kNone;
  if (in_file) {
    slot.block = free_blocks_.back();
    free_blocks_.pop_back();
  }
  std::byte* rows = block_rows(slot.block);
  const Delivery delivery{next_index_, slot.first_ray, {rows, slot.rays * config_.asked.row_bytes()}, index};
  if (in_file) {
    RAYMILL_RETURN_IF_ERROR(merge_stragglers(slot));
    RAYMILL_RETURN_IF_ERROR(read_at(file_offset(slot), delivery.rows));
  } else {
    compact(rows, slot.rays);
  }
  slot.state = State::held;
  order_.pop_front();
  ++next_index_;
  return delivery;
}

// From the kept layout to the asked one, in place: rows only get shorter.
void ResultWindow::compact(std::byte* rows, std::uint32_t count) const {
  if (config_.asked.row_bytes() == config_.kept.row_bytes()) {
    return;
  }
  for (std::uint32_t i = 0; i < count; ++i) {
    config_.asked.write(config_.kept.read(rows + i * config_.kept.row_bytes()), rows + i * config_.asked.row_bytes());
  }
}

void ResultWindow::free_slot(std::uint32_t index) {
  if (slots_[index].block != kNone) {
    free_blocks_.push_back(slots_[index].block);
  }
  if (slots_[index].place != kNone) {
    free_places_.push_back(slots_[index].place);
  }
  slots_[index] = {};
  bases_[index] = nullptr;
  stragglers_[index] = nullptr;
  tnears_[index] = nullptr;
  free_slots_.push_back(index);
}

Status ResultWindow::open_file() {
  if (file_ >= 0) {
    return {};
  }
  file_ = storage::open_nameless(config_.spill_directory);
  if (file_ < 0) {
    return {ErrorCode::io, "cannot make a temporary file for results in " + config_.spill_directory + ": " +
                               std::strerror(errno) + "; set TMPDIR to a folder with room"};
  }
  return {};
}

// Appends a chunk's rows in the asked layout; its block's contents are lost.
Status ResultWindow::write_rows(Slot& slot) {
  RAYMILL_RETURN_IF_ERROR(open_file());
  if (free_places_.empty()) {
    free_places_.push_back(places_++);
  }
  slot.place = free_places_.back();
  free_places_.pop_back();
  std::byte* rows = block_rows(slot.block);
  compact(rows, slot.rays);
  const std::size_t size = slot.rays * config_.asked.row_bytes();
  spilled_bytes_ += size;
  return write_at(file_offset(slot), {rows, size});
}

Status ResultWindow::write_at(std::uint64_t offset, std::span<const std::byte> bytes) const {
  if (!storage::write_fully(file_, bytes, offset)) {
    return {storage::write_error(errno), "cannot keep results in a temporary file in " + config_.spill_directory +
                                             ": " + std::strerror(errno) +
                                             "; fetch results while pushing, or set TMPDIR to a folder with room"};
  }
  return {};
}

Status ResultWindow::read_at(std::uint64_t offset, std::span<std::byte> bytes) const {
  const auto got = storage::read_fully(file_, bytes, offset);
  if (got != bytes.size()) {
    return {ErrorCode::io, "cannot read results back from a temporary file in " + config_.spill_directory + ": " +
                               std::strerror(got ? EIO : errno)};
  }
  return {};
}

// Puts the rows of a done chunk's late rays among the others in the file, in pieces, and frees them.
Status ResultWindow::merge_stragglers(Slot& slot) const {
  if (!slot.stragglers) {
    return {};
  }
  const StragglerRows& late = *slot.stragglers;
  const std::size_t row_bytes = config_.asked.row_bytes();
  const std::size_t piece_rows = kMergeBytes / row_bytes;
  std::vector<std::byte> piece(piece_rows * row_bytes);
  for (std::size_t next = 0; next < late.positions.size();) {
    const std::size_t first = late.positions[next];
    const std::size_t rows = std::min<std::size_t>(piece_rows, slot.rays - first);
    const std::uint64_t offset = file_offset(slot) + first * row_bytes;
    const auto bytes = std::span(piece).first(rows * row_bytes);
    RAYMILL_RETURN_IF_ERROR(read_at(offset, bytes));
    for (; next < late.positions.size() && late.positions[next] < first + rows; ++next) {
      config_.asked.write(config_.kept.read(late.rows.data() + next * late.row_bytes),
                          piece.data() + (late.positions[next] - first) * row_bytes);
    }
    RAYMILL_RETURN_IF_ERROR(write_at(offset, bytes));
  }
  slot.stragglers.reset();
  return {};
}

void ResultWindow::give_up_block(std::uint32_t index) {
  free_blocks_.push_back(slots_[index].block);
  slots_[index].block = kNone;
  slots_[index].done = {};
  bases_[index] = nullptr;
}

Result<bool> ResultWindow::spill_done() {
  // The latest finished chunk: it is needed last.
  for (std::size_t i = order_.size(); i-- > 0;) {
    Slot& slot = slots_[order_[i]];
    if (slot.block != kNone && slot.state == State::done) {
      RAYMILL_RETURN_IF_ERROR(write_rows(slot));
      give_up_block(order_[i]);
      return true;
    }
  }
  return false;
}

std::optional<std::uint32_t> ResultWindow::find_open() const {
  std::optional<std::uint32_t> best;
  for (const std::uint32_t index : order_) {
    const Slot& slot = slots_[index];
    if (slot.block != kNone && slot.state == State::tracing && slot.remaining <= slot.rays / kOpenShare &&
        straggler_count_ + slot.remaining <= config_.most_stragglers &&
        (!best || slot.remaining < slots_[*best].remaining)) {
      best = index;
    }
  }
  return best;
}

StragglerRows ResultWindow::take_stragglers(const Slot& slot, const std::byte* rows) const {
  StragglerRows late;
  late.row_bytes = config_.kept.row_bytes();
  late.positions.reserve(slot.remaining);
  late.rows.reserve(slot.remaining * late.row_bytes);
  for (std::uint32_t position = 0; position < slot.rays; ++position) {
    if (!slot.done[position]) {
      const std::byte* row = rows + position * late.row_bytes;
      late.positions.push_back(position);
      late.rows.insert(late.rows.end(), row, row + late.row_bytes);
      if (slot.tnears) {
        late.tnears.push_back(slot.tnears[position]);
      }
    }
  }
  return late;
}

Status ResultWindow::spill_open() {
  for (const std::uint32_t index : order_) {
    if (slots_[index].state == State::done && slots_[index].stragglers) {
      RAYMILL_RETURN_IF_ERROR(merge_stragglers(slots_[index]));
      stragglers_[index] = nullptr;
    }
  }
  while (free_blocks_.size() < config_.blocks / 2) {
    const auto index = find_open();
    if (!index) {
      break;
    }
    Slot& slot = slots_[*index];
    slot.stragglers = std::make_unique<StragglerRows>(take_stragglers(slot, block_rows(slot.block)));
    RAYMILL_RETURN_IF_ERROR(write_rows(slot));
    give_up_block(*index);
    straggler_count_ += slot.remaining;
    stragglers_[*index] = slot.stragglers.get();
    slot.tnears.reset();
    tnears_[*index] = nullptr;
  }
  return {};
}

}  // namespace raymill::traversal
