#include "traversal/result_window.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace raymill::traversal {

std::uint64_t ResultWindow::bytes(const Config& config) {
  return (std::uint64_t(config.slots) << config.chunk_shift) * (config.kept.row_bytes() + sizeof(float));
}

Result<std::unique_ptr<ResultWindow>> ResultWindow::create(const Config& config, storage::Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(storage::BudgetReservation reservation, ledger.claim(storage::Tag::results, bytes(config)));
  std::unique_ptr<ResultWindow> window(new ResultWindow(config));
  if (window->memory_.data() == nullptr) {
    return {ErrorCode::budget_exceeded, "the system has no address space for the results in flight"};
  }
  window->reservation_ = std::move(reservation);
  return window;
}

ResultWindow::ResultWindow(const Config& config)
    : config_(config),
      memory_((std::uint64_t(config.slots) << config.chunk_shift) * config.kept.row_bytes()),
      slots_(config.slots),
      tnears_(config.slots, nullptr) {
  assert(config.slots >= kMinSlots);
  table_ = {config.chunk_shift, config.kept.row_bytes(), config.kept, memory_.data(), tnears_.data()};
}

ResultWindow::~ResultWindow() {
  if (file_ >= 0) {
    ::close(file_);
  }
}

std::uint32_t ResultWindow::room() const { return filling_ == kNoSlot ? 0 : chunk_rays() - slots_[filling_].rays; }

std::optional<std::uint32_t> ResultWindow::find_free() const {
  for (std::uint32_t slot = 0; slot < slots_.size(); ++slot) {
    if (slots_[slot].state == State::free) {
      return slot;
    }
  }
  return std::nullopt;
}

std::uint32_t ResultWindow::free_count() const {
  return static_cast<std::uint32_t>(
      std::count_if(slots_.begin(), slots_.end(), [](const Slot& slot) { return slot.state == State::free; }));
}

bool ResultWindow::begin_slot() {
  assert(filling_ == kNoSlot);
  if (free_count() < 2) {
    return false;
  }
  filling_ = *find_free();
  slots_[filling_].state = State::filling;
  slots_[filling_].rays = 0;
  slots_[filling_].remaining = 0;
  order_.push_back({next_ray_, 0, filling_, 0});
  return true;
}

std::uint32_t ResultWindow::next_number() const { return (filling_ << config_.chunk_shift) + slots_[filling_].rays; }

void ResultWindow::add(std::uint32_t rays) {
  slots_[filling_].rays += rays;
  slots_[filling_].remaining += rays;
  order_.back().rays += rays;
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
  filling_ = kNoSlot;
}

float* ResultWindow::tnears_of_filling() {
  Slot& slot = slots_[filling_];
  if (!slot.tnears) {
    slot.tnears = std::make_unique<float[]>(chunk_rays());
    tnears_[filling_] = slot.tnears.get();
  }
  return slot.tnears.get();
}

void ResultWindow::complete(std::uint32_t number) {
  Slot& slot = slots_[number >> config_.chunk_shift];
  if (--slot.remaining == 0 && slot.state == State::tracing) {
    slot.state = State::done;
  }
}

bool ResultWindow::deliverable() const {
  if (order_.empty()) {
    return false;
  }
  const Chunk& chunk = order_.front();
  return chunk.slot == kNoSlot ? find_free().has_value() : slots_[chunk.slot].state == State::done;
}

Result<ResultWindow::Delivery> ResultWindow::deliver() {
  const Chunk chunk = order_.front();
  Delivery delivery{next_index_, chunk.first_ray, {}, chunk.slot};
  if (chunk.slot == kNoSlot) {
    delivery.slot = *find_free();
  }
  std::byte* rows = table_.row(delivery.slot << config_.chunk_shift);
  delivery.rows = {rows, chunk.rays * config_.asked.row_bytes()};
  if (chunk.slot == kNoSlot) {
    std::size_t done = 0;
    while (done < delivery.rows.size()) {
      const ssize_t n =
          ::pread(file_, rows + done, delivery.rows.size() - done, static_cast<off_t>(chunk.file_offset + done));
      if (n == 0 || (n < 0 && errno != EINTR)) {
        return {ErrorCode::io, "cannot read results back from a temporary file in " + config_.spill_directory + ": " +
                                   std::strerror(n < 0 ? errno : EIO)};
      }
      done += n > 0 ? static_cast<std::size_t>(n) : 0;
    }
  } else {
    compact(chunk.slot, chunk.rays);
  }
  slots_[delivery.slot].state = State::held;
  order_.pop_front();
  ++next_index_;
  return delivery;
}

// From the kept layout to the asked one, in place: rows only get shorter.
void ResultWindow::compact(std::uint32_t slot, std::uint32_t rays) {
  if (config_.asked.row_bytes() == config_.kept.row_bytes()) {
    return;
  }
  std::byte* rows = table_.row(slot << config_.chunk_shift);
  for (std::uint32_t i = 0; i < rays; ++i) {
    config_.asked.write(config_.kept.read(rows + i * config_.kept.row_bytes()), rows + i * config_.asked.row_bytes());
  }
}

void ResultWindow::free_slot(std::uint32_t slot) {
  slots_[slot].state = State::free;
  slots_[slot].tnears.reset();
  tnears_[slot] = nullptr;
}

Status ResultWindow::open_file() {
  if (file_ >= 0) {
    return {};
  }
  std::string name = config_.spill_directory + "/raymill-results-XXXXXX";
  file_ = ::mkostemp(name.data(), O_CLOEXEC);
  if (file_ < 0) {
    return {ErrorCode::io, "cannot make a temporary file for results in " + config_.spill_directory + ": " +
                               std::strerror(errno) + "; set TMPDIR to a folder with room"};
  }
  ::unlink(name.c_str());
  return {};
}

Result<bool> ResultWindow::spill() {
  // The latest finished chunk: it is needed last.
  for (std::size_t i = order_.size(); i-- > 0;) {
    Chunk& chunk = order_[i];
    if (chunk.slot == kNoSlot || slots_[chunk.slot].state != State::done) {
      continue;
    }
    RAYMILL_RETURN_IF_ERROR(open_file());
    compact(chunk.slot, chunk.rays);
    const std::size_t size = chunk.rays * config_.asked.row_bytes();
    const std::byte* rows = table_.row(chunk.slot << config_.chunk_shift);
    for (std::size_t done = 0; done < size;) {
      const ssize_t n = ::pwrite(file_, rows + done, size - done, static_cast<off_t>(file_end_ + done));
      if (n < 0 && errno != EINTR) {
        return {errno == ENOSPC ? ErrorCode::disk_full : ErrorCode::io,
                "cannot keep results in a temporary file in " + config_.spill_directory + ": " + std::strerror(errno) +
                    "; fetch results while pushing, or set TMPDIR to a folder with room"};
      }
      done += n > 0 ? static_cast<std::size_t>(n) : 0;
    }
    free_slot(chunk.slot);
    chunk.slot = kNoSlot;
    chunk.file_offset = file_end_;
    file_end_ += size;
    spilled_bytes_ += size;
    return true;
  }
  return false;
}

}  // namespace raymill::traversal
