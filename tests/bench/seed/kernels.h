// The algorithms that are set beside each other, compiled for this machine. kernels-inl.h has the text.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "tests/bench/seed/trees.h"
#include "traversal/query.h"

namespace raymill::bench {

/// The closest hit; of several at the same t that of the least triangle, so the order of visits does not matter.
struct SeedHit {
  float t;  ///< infinity: none
  float u, v;
  std::uint32_t triangle;  ///< in leaf order; kNoReference: none

  bool operator==(const SeedHit&) const = default;
};

/// Sums over rays.
struct Counters {
  std::uint64_t nodes = 0;  ///< whose boxes were tested: N of a wide node, one of the other layouts
  std::uint64_t triangles = 0;
  std::array<std::uint64_t, 17> children_hit{};  ///< [i]: visited nodes of which i children were hit
  std::uint64_t most_entries = 0;                ///< of all stacks the most that one held
};

/// What the others of its width are compared with, and stand behind.
constexpr const char* kStackName = "stack";

struct Algorithm {
  std::string name;
  unsigned width = 2;
  bool is_wide = false;          ///< walks WideTree<width>
  std::size_t state_bytes = 0;   ///< states.h
  std::size_t record_bytes = 0;  ///< of RayRecord
  void (*trace)(const Trees& trees, std::span<const Ray> rays, std::span<SeedHit> hits) = nullptr;
  Counters (*count)(const Trees& trees, std::span<const Ray> rays, std::span<SeedHit> hits) = nullptr;  ///< slower
};

std::vector<Algorithm> algorithms();
/// Every triangle of the scene, one after the other.
Algorithm brute_force();
/// Of algorithms(): "avx512", "avx2" or "scalar".
std::string isa_of_algorithms();

namespace avx512 {
std::vector<Algorithm> algorithms();
}
namespace avx2 {
std::vector<Algorithm> algorithms();
}
namespace scalar {
std::vector<Algorithm> algorithms();
Algorithm brute_force();
}  // namespace scalar

}  // namespace raymill::bench
