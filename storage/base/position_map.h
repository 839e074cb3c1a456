// PositionMap: numbers distinct positions in the order in which they first come; equal means equal bits.
//
// Open addressing with linear probing over a power-of-two table. The newest positions can be taken back (rollback),
// and clear() costs nothing: slots of earlier rounds are stale by their round number. Thread-confined.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#include "storage/base/vec3.h"

namespace raymill::storage {

class PositionMap {
 public:
  explicit PositionMap(std::size_t expected = 1024) : slots_(std::bit_ceil(expected * 2)) {}

  /// The position's number; a new position gets size() before the call.
  std::uint32_t insert(const Vec3f& p) {
    if ((positions_.size() + 1) * 2 > slots_.size()) {
      grow();
    }
    std::size_t i = find(p);
    if (slots_[i].round != round_) {
      slots_[i] = {round_, static_cast<std::uint32_t>(positions_.size())};
      positions_.push_back(p);
    }
    return slots_[i].number;
  }

  /// Takes back all but the first `size` positions.
  void rollback(std::size_t size) {
    // Undone newest first, a slot is emptied only after every entry that probed past it is gone.
    while (positions_.size() > size) {
      slots_[find(positions_.back())].round = 0;
      positions_.pop_back();
    }
  }

  void clear() {
    positions_.clear();
    ++round_;
  }

  [[nodiscard]] std::size_t size() const { return positions_.size(); }
  [[nodiscard]] const std::vector<Vec3f>& positions() const { return positions_; }

 private:
  struct Slot {
    std::uint32_t round = 0;  // clear() is called for each page: 2^32 of them are out of reach
    std::uint32_t number = 0;
  };

  static std::uint64_t hash(const Vec3f& p) {
    const auto bits = std::bit_cast<std::array<std::uint32_t, 3>>(p);
    std::uint64_t h = bits[0] * 0x9E3779B97F4A7C15u + bits[1];
    h = (h ^ h >> 29) * 0xBF58476D1CE4E5B9u + bits[2];
    h = (h ^ h >> 32) * 0x94D049BB133111EBu;
    return h ^ h >> 31;
  }

  // The slot that holds p, or the free slot where it belongs.
  [[nodiscard]] std::size_t find(const Vec3f& p) const {
    const std::size_t mask = slots_.size() - 1;
    std::size_t i = hash(p) & mask;
    while (slots_[i].round == round_ && std::memcmp(&positions_[slots_[i].number], &p, sizeof p) != 0) {
      i = (i + 1) & mask;
    }
    return i;
  }

  void grow() {
    slots_.assign(slots_.size() * 2, {});
    for (std::uint32_t number = 0; number < positions_.size(); ++number) {
      slots_[find(positions_[number])] = {round_, number};
    }
  }

  std::vector<Slot> slots_;
  std::vector<Vec3f> positions_;
  std::uint32_t round_ = 1;
};

}  // namespace raymill::storage
