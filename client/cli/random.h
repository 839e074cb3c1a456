// Random numbers by counter: a value depends on a key and a place and on nothing that was drawn before, so any part of
// a picture or a scene can be made in any order with the same result. Pure functions.
#pragma once

#include <cstdint>

namespace raymill::client {

/// The finaliser of SplitMix64 (Steele, Lea, Flood 2014): a bijection of 64 bits that mixes well.
constexpr std::uint64_t mix(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15u;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}
constexpr std::uint64_t mix(std::uint64_t a, std::uint64_t b) { return mix(mix(a) ^ b); }
constexpr std::uint64_t mix(std::uint64_t a, std::uint64_t b, std::uint64_t c) { return mix(mix(a, b) ^ c); }

/// The top 24 bits as a float in [0, 1).
constexpr float unit_float(std::uint64_t bits) { return static_cast<float>(bits >> 40) * 0x1p-24F; }

/// A stream of draws from one key. Thread-confined.
class Random {
 public:
  explicit constexpr Random(std::uint64_t key) : key_(mix(key)) {}
  constexpr std::uint64_t bits() { return mix(key_ + counter_++ * 0xD1342543DE82EF95u); }
  constexpr float unit() { return unit_float(bits()); }
  constexpr float range(float low, float high) { return low + (high - low) * unit(); }
  /// A whole number in [low, high].
  constexpr std::uint32_t whole(std::uint32_t low, std::uint32_t high) {
    return low + static_cast<std::uint32_t>(((bits() >> 32) * (std::uint64_t(high) - low + 1)) >> 32);
  }

 private:
  std::uint64_t key_;
  std::uint64_t counter_ = 0;
};

/// Where `index` goes under a permutation of [0, count) chosen by `seed`: a Feistel network of four rounds on the least
/// even number of bits that holds `count`, walked until it lands inside (Black, Rogaway 2002: cycle walking).
std::uint64_t permute(std::uint64_t index, std::uint64_t count, std::uint64_t seed);

}  // namespace raymill::client
