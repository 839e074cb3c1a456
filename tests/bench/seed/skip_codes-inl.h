// Skip codes and the bitstack of Afra & Szirmay-Kalos 2014, compiled once per ISA.
//
// A skip code has N - 1 bits and belongs to a child: bit i says that the sibling i + 1 slots further, counted in a
// circle, is still to be visited. The bitstack holds the code of every node on the path, that of the deepest one
// lowest.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <type_traits>

#include "tests/bench/seed/states.h"

namespace raymill::bench::RAYMILL_ISA {

template <unsigned N>
constexpr unsigned kCodeMask = (1U << (N - 1)) - 1;

/// Codes by arithmetic.
///
/// first(): for bit s of the mask and slot = i, the code's bit is s - i - 1 where s > i, N + s - i - 1 where s < i:
///   mask >> (i + 1)      puts s > i there, and drops the others;
///   mask << (N - 1 - i)  puts s < i there, s = i at N - 1 and s > i above it, which kCodeMask drops.
template <unsigned N>
struct ArithmeticCodes {
  static constexpr const char* kName = "stackless arithmetic";
  /// Of the child in `slot`, `mask` being the children that are hit.
  static unsigned first(unsigned mask, unsigned slot) {
    return (mask >> (slot + 1) | mask << (N - 1 - slot)) & kCodeMask<N>;
  }
  /// Of the sibling that `code`, which is not 0, says comes first. What lies before it has been visited.
  static unsigned next(unsigned code) { return code >> (static_cast<unsigned>(std::countr_zero(code)) + 1); }
};

/// Codes by look-up. A mask of 16 bits is looked up in halves: the code of a union is the union of the codes.
template <unsigned N>
struct CodeTable {
  static constexpr unsigned kHalves = N == 16 ? 2 : 1;
  static constexpr unsigned kHalfBits = N / kHalves;
  using Code = std::conditional_t<N == 16, std::uint16_t, std::uint8_t>;
  Code first[N][kHalves][1U << kHalfBits] = {};
  Code next[1U << (N - 1)] = {};

  constexpr CodeTable() {
    for (unsigned slot = 0; slot < N; ++slot) {
      for (unsigned half = 0; half < kHalves; ++half) {
        for (unsigned bits = 0; bits < 1U << kHalfBits; ++bits) {
          for (unsigned i = 0; i + 1 < N; ++i) {
            const unsigned sibling = (slot + i + 1) % N;
            const bool is_hit = sibling / kHalfBits == half && (bits >> sibling % kHalfBits & 1) != 0;
            first[slot][half][bits] = static_cast<Code>(first[slot][half][bits] | (is_hit ? 1U << i : 0U));
          }
        }
      }
    }
    for (unsigned code = 1; code < 1U << (N - 1); ++code) {
      unsigned rest = code;
      while ((rest & 1) == 0) {
        rest >>= 1;
      }
      next[code] = static_cast<Code>(rest >> 1);
    }
  }
};
template <unsigned N>
inline constexpr CodeTable<N> kCodes;

template <unsigned N>
struct TableCodes {
  static constexpr const char* kName = "stackless table";
  static unsigned first(unsigned mask, unsigned slot) {
    if constexpr (N == 16) {
      return kCodes<N>.first[slot][0][mask & 0xFF] | kCodes<N>.first[slot][1][mask >> 8];
    } else {
      return kCodes<N>.first[slot][0][mask];
    }
  }
  static unsigned next(unsigned code) { return kCodes<N>.next[code]; }
};

/// At most kMostLevels codes; build_trees() refuses deeper trees.
template <unsigned N>
class Bitstack {
 public:
  void push(unsigned code) {
    for (unsigned i = kWords; i-- > 1;) {
      words_[i] = words_[i] << kCodeBits | words_[i - 1] >> (kWordBits - kCodeBits);
    }
    words_[0] = words_[0] << kCodeBits | code;
  }
  void pop() {
    for (unsigned i = 0; i + 1 < kWords; ++i) {
      words_[i] = words_[i] >> kCodeBits | words_[i + 1] << (kWordBits - kCodeBits);
    }
    words_[kWords - 1] >>= kCodeBits;
  }
  [[nodiscard]] unsigned top() const { return static_cast<unsigned>(words_[0]) & kCodeMask<N>; }
  /// `before` is top().
  void replace_top(unsigned before, unsigned code) { words_[0] ^= before ^ code; }
  /// Nothing is to be visited any more on any level.
  [[nodiscard]] bool empty() const {
    Word bits = 0;
    for (const Word word : words_) {
      bits |= word;
    }
    return bits == 0;
  }

 private:
  // Registers: arrays of 64 bits would be shifted in memory.
  using Word = std::conditional_t<kBitstackBits<N> == 64, std::uint64_t, unsigned __int128>;
  static constexpr unsigned kCodeBits = N - 1;
  static constexpr unsigned kWordBits = 8 * sizeof(Word);
  static constexpr unsigned kWords = kBitstackBits<N> / kWordBits;
  std::array<Word, kWords> words_{};
};

}  // namespace raymill::bench::RAYMILL_ISA
