// What a ray that is set aside must keep for each algorithm, besides org, dir, tnear, tfar and its hit. Plain data.
//
// 64-bit words are kept as halves, so that a record is not padded for them.
#pragma once

#include <array>
#include <cstdint>

#include "traversal/query.h"

namespace raymill::bench {

/// Afra & Szirmay-Kalos 2014 take 64 bits for N = 2 and 128 for N = 4. N = 8 has the 128 bits too; N = 16 takes 15 bits
/// a level and needs 256.
template <unsigned N>
constexpr unsigned kBitstackBits = N == 2    ? 64
                                   : N == 16 ? 256
                                             : 128;

/// N - 1 bits for each level below the root. The stacks are given the same depth: 64 entries for N = 2, as in the
/// paper.
template <unsigned N>
constexpr unsigned kMostLevels = kBitstackBits<N> / (N - 1);
static_assert(kMostLevels<2> == 64 && kMostLevels<4> == 42 && kMostLevels<8> == 18 && kMostLevels<16> == 17);

struct StackEntry {
  std::uint32_t reference;
  float distance;  ///< where the ray enters the child's box
};

/// A node leaves at most N - 1 children on the stack: the nearest one is entered at once.
template <unsigned N>
constexpr unsigned kStackEntries = kMostLevels<N>*(N - 1);

template <unsigned N>
struct StackState {
  std::uint32_t reference;  ///< what is visited next
  std::uint32_t count;
  std::array<StackEntry, kStackEntries<N>> entries;
};

template <unsigned N>
struct StacklessState {
  std::uint32_t node;  ///< its highest bit: whether to visit the node, or to go on from it with the bitstack
  std::array<std::uint32_t, kBitstackBits<N> / 32> bitstack;
};

struct TrailState {
  std::array<std::uint32_t, 2> trail;
  std::uint32_t reference;  ///< what is visited next
  std::uint8_t level;
  std::uint8_t popped_level;
};

/// The trail's highest bit stands above the root's.
constexpr unsigned kMostTrailLevels = 63;

struct SkipState {
  std::uint32_t node;
};

struct ParentState {
  std::uint32_t node_and_step;  ///< the highest two bits: from where the ray came
};

static_assert(sizeof(StackState<2>) == 520 && sizeof(StackState<4>) == 1016 && sizeof(StackState<8>) == 1016 &&
              sizeof(StackState<16>) == 2048);
static_assert(sizeof(StacklessState<2>) == 12 && sizeof(StacklessState<4>) == 20 && sizeof(StacklessState<8>) == 20 &&
              sizeof(StacklessState<16>) == 36);
static_assert(sizeof(TrailState) == 16 && sizeof(SkipState) == 4 && sizeof(ParentState) == 4);

/// A ray that is set aside.
template <typename State>
struct RayRecord {
  Ray ray;  ///< tfar: of the hit, if there is one
  float u, v;
  std::uint32_t triangle;
  State state;
};
static_assert(sizeof(RayRecord<SkipState>) == 48, "the ray, its hit and the state are not padded");

}  // namespace raymill::bench
