// Ledger: the one account of the process's memory.
//
// Invariant: the sum of all claims never passes the budget. Memory is claimed first and allocated after; a claim that
// cannot be met fails or waits, it never grows the budget. Tags say who holds what. The fixed base (code, libraries,
// thread stacks, allocator slack) is measured at start and claimed under Tag::base.
// Thread-safe.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "storage/base/status.h"

namespace raymill {

/// Bytes per unit, for readable budgets.
constexpr std::uint64_t kibibytes(std::uint64_t n) { return n << 10; }
constexpr std::uint64_t mebibytes(std::uint64_t n) { return n << 20; }
constexpr std::uint64_t gibibytes(std::uint64_t n) { return n << 30; }

namespace storage {

enum class Tag : std::uint8_t { base, directory, pages, decode, io, rays, results, build, transport, count };
std::string_view to_string(Tag tag);

class Ledger;

/// A claim on the budget, given back on destruction. Move-only: two owners would give it back twice.
class BudgetReservation {
 public:
  BudgetReservation() = default;
  BudgetReservation(BudgetReservation&& other) noexcept { swap(other); }
  BudgetReservation& operator=(BudgetReservation&& other) noexcept {
    BudgetReservation(std::move(other)).swap(*this);
    return *this;
  }
  BudgetReservation(const BudgetReservation&) = delete;
  BudgetReservation& operator=(const BudgetReservation&) = delete;
  ~BudgetReservation();

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  /// Grows or shrinks the claim to `bytes`; on failure (budget_exceeded) the old claim stands.
  Status resize(std::uint64_t bytes);

 private:
  friend class Ledger;
  void swap(BudgetReservation& other) noexcept {
    std::swap(ledger_, other.ledger_);
    std::swap(tag_, other.tag_);
    std::swap(bytes_, other.bytes_);
  }
  Ledger* ledger_ = nullptr;
  Tag tag_ = Tag::base;
  std::uint64_t bytes_ = 0;
};

class Ledger {
 public:
  explicit Ledger(std::uint64_t budget_bytes) : budget_bytes_(budget_bytes) {}
  Ledger(const Ledger&) = delete;
  Ledger& operator=(const Ledger&) = delete;

  /// Claims `bytes` under `tag`. Fails with budget_exceeded; the message names what is needed and what is given.
  Result<BudgetReservation> claim(Tag tag, std::uint64_t bytes);

  [[nodiscard]] std::uint64_t budget_bytes() const { return budget_bytes_; }
  [[nodiscard]] std::uint64_t free_bytes() const;
  [[nodiscard]] std::uint64_t used_bytes(Tag tag) const;
  [[nodiscard]] std::uint64_t peak_bytes(Tag tag) const;
  /// Of every tag that was ever claimed, by name.
  [[nodiscard]] std::map<std::string, std::uint64_t> peaks() const;

 private:
  friend class BudgetReservation;
  Status change(Tag tag, std::uint64_t from_bytes, std::uint64_t to_bytes);

  const std::uint64_t budget_bytes_;
  mutable std::mutex mutex_;
  std::uint64_t total_bytes_ = 0;
  std::array<std::uint64_t, static_cast<std::size_t>(Tag::count)> used_bytes_{};
  std::array<std::uint64_t, static_cast<std::size_t>(Tag::count)> peak_bytes_{};
};

/// Resident set size of this process now, and at its highest (VmHWM), in bytes; 0 where the kernel does not tell.
std::uint64_t resident_bytes();
std::uint64_t peak_resident_bytes();

/// "41.0 MiB": for messages.
std::string format_bytes(std::uint64_t bytes);

}  // namespace storage
}  // namespace raymill
