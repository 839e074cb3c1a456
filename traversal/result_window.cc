#include "traversal/result_window.h"

#include <algorithm>
#include <cassert>
#include <cstring>
#include <utility>

#include "storage/base/checksum.h"

namespace raymill::traversal {

std::uint64_t ResultWindow::bytes(const Config& config) {
  const std::uint64_t chunk_bytes = (std::uint64_t(1) << config.chunk_shift) * config.layout.row_bytes();
  // A slot has a place in three lists; collect() reads a block at a time and lists the places of a chunk, sort_blocks()
  // those in hand.
  const std::uint64_t delivery = config.lists.pieces > 0
                                     ? HitLists::bytes(config.lists) + config.block_bytes + 2 * config.blocks
                                     : kMostHeld * (chunk_bytes + 2 * config.block_bytes);
  return config.blocks * (config.block_bytes + sizeof(std::uint32_t)) + delivery +
         config.slots * (sizeof(Slot) + 3 * sizeof(std::uint32_t)) +
         SpillFile::table_bytes(config.blocks * kPlacesPerBlock);
}

Result<std::unique_ptr<ResultWindow>> ResultWindow::create(const Config& config, storage::Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(storage::BudgetReservation reservation, ledger.claim(storage::Tag::results, bytes(config)));
  std::unique_ptr<ResultWindow> window(new ResultWindow(config));
  const bool ok = window->lists_ ? window->lists_->ok() : window->buffers_.data() != nullptr;
  if (window->blocks_.data() == nullptr || !ok) {
    return {ErrorCode::budget_exceeded, "the system has no address space for the results in flight"};
  }
  window->reservation_ = std::move(reservation);
  return window;
}

ResultWindow::ResultWindow(const Config& config)
    : config_(config),
      blocks_(config.blocks * config.block_bytes),
      buffers_(config.lists.pieces > 0 ? 0 : kMostHeld * (config.layout.row_bytes() << config.chunk_shift)),
      slots_(config.slots),
      file_({config.spill_directory, "results", config.block_bytes, config.blocks * kPlacesPerBlock, false}) {
  assert(config.blocks >= kMinBlocks && block_rows() > 0);
  assert(config.chunk_shift <= 8 * sizeof(Position) && std::uint64_t(config.slots) << config.chunk_shift <= 1ULL << 32);
  const auto fill = [](std::vector<std::uint32_t>& list, std::uint32_t count) {
    list.reserve(count);
    for (std::uint32_t i = count; i-- > 0;) {
      list.push_back(i);
    }
  };
  fill(free_slots_, config.slots);
  fill(free_blocks_, config.blocks);
  fill(free_buffers_, kMostHeld);
  if (config.lists.pieces > 0) {
    lists_ = std::make_unique<HitLists>(config.lists);
    sorting_.blocks.reserve(most_in_hand());
    sorting_.places.reserve(most_in_hand());
  }
}

std::uint32_t ResultWindow::room() const { return filling_ == kNone ? 0 : chunk_rays() - slots_[filling_].rays; }

bool ResultWindow::begin_slot() {
  assert(filling_ == kNone);
  if (!can_begin()) {
    return false;
  }
  ++under_way_;
  filling_ = free_slots_.back();
  free_slots_.pop_back();
  slots_[filling_] = {};
  slots_[filling_].state = State::filling;
  slots_[filling_].first_ray = next_ray_;
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
    --under_way_;
    free_slot(filling_);
  } else if (slot.remaining == 0) {
    end_slot(slot);
  } else {
    slot.state = State::tracing;
  }
  filling_ = kNone;
}

Result<bool> ResultWindow::complete(std::uint32_t number, const Hit& hit, const HitAttributes& attributes) {
  RAYMILL_RETURN_IF_ERROR(add_hit(number, hit, attributes));
  return complete(number, 1);
}

Status ResultWindow::add_hit(std::uint32_t number, const Hit& hit, const HitAttributes& attributes) {
  Slot& slot = slots_[number >> config_.chunk_shift];
  RAYMILL_RETURN_IF_ERROR(open_rows(slot).status());
  write_entry(number, hit, attributes, block(slot.open) + sizeof(RowBlock) + header(slot.open).rows++ * entry_bytes());
  return {};
}

bool ResultWindow::complete(std::uint32_t number, std::uint32_t rays) {
  Slot& slot = slots_[number >> config_.chunk_shift];
  slot.remaining -= rays;
  if (slot.remaining > 0 || slot.state != State::tracing) {
    return false;
  }
  end_slot(slot);
  return true;
}

void ResultWindow::write_entry(std::uint32_t number, const Hit& hit, const HitAttributes& attributes,
                               std::byte* entry) const {
  const auto position = static_cast<Position>(number & (chunk_rays() - 1));
  std::memcpy(entry, &position, sizeof position);
  config_.layout.write(hit, attributes, entry + sizeof position);
}

Result<bool> ResultWindow::complete_all(std::uint32_t number, std::span<const std::byte> entries) {
  Slot& slot = slots_[number >> config_.chunk_shift];
  const auto rays = static_cast<std::uint32_t>(entries.size() / entry_bytes());
  while (!entries.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(const std::uint32_t places, open_rows(slot));
    const auto some = entries.first(std::min(entries.size(), places * entry_bytes()));
    RowBlock& open = header(slot.open);
    std::memcpy(block(slot.open) + sizeof(RowBlock) + open.rows * entry_bytes(), some.data(), some.size());
    open.rows += static_cast<std::uint32_t>(some.size() / entry_bytes());
    entries = entries.subspan(some.size());
  }
  return complete(number, rays);
}

Result<std::uint32_t> ResultWindow::open_rows(Slot& slot) {
  if (slot.open == kNone || header(slot.open).rows == block_rows()) {
    RAYMILL_RETURN_IF_ERROR(open_block(slot));
  }
  return block_rows() - header(slot.open).rows;
}

// All rays of the slot are done.
void ResultWindow::end_slot(Slot& slot) {
  slot.state = State::done;
  --under_way_;
  close_block(slot);
}

// The block takes no more rows: it joins the full ones.
void ResultWindow::close_block(Slot& slot) {
  if (slot.open != kNone) {
    header(slot.open).next = slot.full;
    slot.full = std::exchange(slot.open, kNone);
  }
}

// The full block, if any, joins the others; an empty one takes its place.
Status ResultWindow::open_block(Slot& slot) {
  close_block(slot);
  if (free_blocks_.empty()) {
    RAYMILL_RETURN_IF_ERROR(spill_block());
  }
  slot.open = free_blocks_.back();
  free_blocks_.pop_back();
  header(slot.open) = {};
  return {};
}

// The slot whose block goes: one that is sorted, for its blocks are about to be read whole, or the latest with a full
// one, for it is needed last; while a chunk that is fetched has them all, the one whose block is fullest.
std::uint32_t ResultWindow::choose_victim() const {
  if (sorting_.slot != kNone && slots_[sorting_.slot].full != kNone) {
    return sorting_.slot;
  }
  std::uint32_t fullest = kNone;
  for (std::size_t i = order_.size(); i-- > 0;) {
    const Slot& slot = slots_[order_[i]];
    if (slot.full != kNone) {
      return order_[i];
    }
    if (slot.open != kNone && (fullest == kNone || header(slot.open).rows > header(slots_[fullest].open).rows)) {
      fullest = order_[i];
    }
  }
  return fullest;
}

Status ResultWindow::spill_block() {
  const std::uint32_t victim = choose_victim();
  if (victim == kNone) {
    return {ErrorCode::budget_exceeded, "all results are being fetched; let go of hits that were fetched before"};
  }
  Slot& slot = slots_[victim];
  const std::uint32_t index = slot.full != kNone ? slot.full : slot.open;
  if (slot.full != kNone) {
    slot.full = header(index).next;
  } else {
    slot.open = kNone;
  }
  const std::uint32_t place = file_.take();
  header(index).next = std::exchange(slot.place, place);
  header(index).checksum = RowBlock::checksum_of(block(index), config_.layout.row_bytes());
  spilled_bytes_ += config_.block_bytes;
  free_blocks_.push_back(index);
  return file_.write(place, {block(index), config_.block_bytes});
}

bool ResultWindow::deliverable() const {
  if (lists_ && (sorting_.slot != kNone || !lists_->has_piece())) {
    return lists_->has_piece();
  }
  return !order_.empty() && slots_[order_.front()].state == State::done && !free_buffers_.empty();
}

ResultWindow::Delivery ResultWindow::begin_delivery() {
  const std::uint32_t index = order_.front();
  Slot& slot = slots_[index];
  order_.pop_front();
  slot.state = State::held;
  slot.buffer = free_buffers_.back();
  free_buffers_.pop_back();
  const std::size_t row_bytes = config_.layout.row_bytes();
  std::byte* buffer = buffers_.data() + slot.buffer * (row_bytes << config_.chunk_shift);
  return {next_index_++, slot.first_ray, {buffer, slot.rays * row_bytes}, index, {}};
}

Status ResultWindow::damaged() const {
  return {ErrorCode::checksum_mismatch, "results came back from a temporary file in " + config_.spill_directory +
                                            " other than they went; check that disk"};
}

// Each row to its position.
Status ResultWindow::place_rows(const std::byte* block, const Delivery& delivery, std::uint32_t& rows_left) const {
  const std::uint32_t rows = RowBlock::of(block).rows;
  const std::size_t row_bytes = config_.layout.row_bytes();
  if (rows > rows_left) {
    return damaged();
  }
  rows_left -= rows;
  const std::byte* entries = RowBlock::entries(block);
  for (const std::byte* entry = entries; entry < entries + rows * entry_bytes(); entry += entry_bytes()) {
    const Position position = RowBlock::position_of(entry);
    if ((position + 1) * row_bytes > delivery.rows.size()) {
      return damaged();
    }
    std::memcpy(delivery.rows.data() + position * row_bytes, entry + sizeof position, row_bytes);
  }
  return {};
}

Status ResultWindow::read_block(std::uint32_t place, std::span<std::byte> block) const {
  RAYMILL_RETURN_IF_ERROR(file_.read(place, block));
  const RowBlock& head = RowBlock::of(block.data());
  const bool whole =
      head.rows <= block_rows() && head.checksum == RowBlock::checksum_of(block.data(), config_.layout.row_bytes());
  return whole ? Status() : damaged();
}

Status ResultWindow::collect(Delivery& delivery) {
  const Slot& slot = slots_[delivery.slot];
  std::uint32_t rows_left = slot.rays;
  for (std::uint32_t index = slot.full; index != kNone; index = header(index).next) {
    RAYMILL_RETURN_IF_ERROR(place_rows(block(index), delivery, rows_left));
  }
  if (slot.place != kNone) {
    std::vector<std::byte> buffer(config_.block_bytes);
    for (std::uint32_t place = slot.place; place != kNone; place = RowBlock::of(buffer.data()).next) {
      RAYMILL_RETURN_IF_ERROR(read_block(place, buffer));
      delivery.places.push_back(place);
      RAYMILL_RETURN_IF_ERROR(place_rows(buffer.data(), delivery, rows_left));
    }
  }
  return rows_left == 0 ? Status() : damaged();
}

void ResultWindow::end_delivery(const Delivery& delivery) {
  Slot& slot = slots_[delivery.slot];
  while (slot.full != kNone) {
    free_blocks_.push_back(slot.full);
    slot.full = header(slot.full).next;
  }
  for (const std::uint32_t place : delivery.places) {
    file_.give(place);
  }
  slot.place = kNone;
}

bool ResultWindow::begin_blocks() {
  if (sorting_.slot == kNone) {
    sorting_.slot = order_.front();
    order_.pop_front();
    slots_[sorting_.slot].state = State::held;
    lists_->begin(slots_[sorting_.slot].rays);
  }
  Slot& slot = slots_[sorting_.slot];
  while (slot.full != kNone && sorting_.blocks.size() < most_in_hand()) {
    sorting_.blocks.push_back(slot.full);
    slot.full = header(slot.full).next;
  }
  if (sorting_.blocks.empty()) {
    sorting_.place = std::exchange(slot.place, kNone);
  }
  return !sorting_.blocks.empty() || sorting_.place != kNone;
}

Status ResultWindow::sort_blocks() {
  for (const std::uint32_t index : sorting_.blocks) {
    RAYMILL_RETURN_IF_ERROR(lists_->take(block(index)));
  }
  std::vector<std::byte> buffer(sorting_.place != kNone ? config_.block_bytes : 0);
  while (sorting_.place != kNone && sorting_.places.size() < most_in_hand()) {
    RAYMILL_RETURN_IF_ERROR(read_block(sorting_.place, buffer));
    sorting_.places.push_back(sorting_.place);
    RAYMILL_RETURN_IF_ERROR(lists_->take(buffer.data()));
    sorting_.place = RowBlock::of(buffer.data()).next;
  }
  return {};
}

void ResultWindow::end_blocks() {
  free_blocks_.insert(free_blocks_.end(), sorting_.blocks.begin(), sorting_.blocks.end());
  for (const std::uint32_t place : sorting_.places) {
    file_.give(place);
  }
  if (sorting_.blocks.empty()) {
    slots_[sorting_.slot].place = std::exchange(sorting_.place, kNone);
  }
  sorting_.blocks.clear();
  sorting_.places.clear();
  lists_spilled_bytes_ = lists_->spilled_bytes();
}

HitLists::Piece ResultWindow::begin_piece() {
  HitLists::Piece piece;
  piece.number = lists_->take_piece();
  return piece;
}

ResultWindow::PiecePlace ResultWindow::end_piece(const HitLists::Piece& piece) {
  const PiecePlace place{next_index_++, slots_[sorting_.slot].first_ray + piece.first_position};
  lists_spilled_bytes_ = lists_->spilled_bytes();
  if (piece.is_last) {
    free_slot(std::exchange(sorting_.slot, kNone));
  }
  return place;
}

void ResultWindow::free_slot(std::uint32_t index) {
  if (slots_[index].buffer != kNone) {
    free_buffers_.push_back(slots_[index].buffer);
  }
  slots_[index] = {};
  free_slots_.push_back(index);
}

}  // namespace raymill::traversal
