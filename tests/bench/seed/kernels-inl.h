// The algorithms and their list, compiled once per ISA. The includer defines RAYMILL_ISA and includes its simd header
// first.
//
//   tests-inl.h       the ray, boxes, triangles
//   skip_codes-inl.h  skip codes and bitstack
//   wide-inl.h        stack, stackless
//   binary-inl.h      restart trail, skip pointers, parent pointers
#pragma once

#include "tests/bench/seed/binary-inl.h"
#include "tests/bench/seed/wide-inl.h"

namespace raymill::bench::RAYMILL_ISA {

struct BruteForce {
  static constexpr const char* kName = "brute force";
  static constexpr unsigned kWidth = 2;
  static constexpr bool kWide = false;
  using State = SkipState;

  template <bool kCounts>
  static void trace(const Trees& trees, RayWork& ray, Tally<kCounts>&) {
    test_triangles(trees, ray, 0, static_cast<std::uint32_t>(trees.triangles.size()));
  }
};

template <typename Traversal, bool kCounts>
Counters trace_rays(const Trees& trees, std::span<const Ray> rays, std::span<SeedHit> hits) {
  Tally<kCounts> tally;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    RayWork ray(rays[i]);
    Traversal::template trace<kCounts>(trees, ray, tally);
    hits[i] = ray.hit();
  }
  return tally.sums;
}

template <typename Traversal>
Algorithm algorithm_of() {
  return {.name = Traversal::kName,
          .width = Traversal::kWidth,
          .is_wide = Traversal::kWide,
          .state_bytes = sizeof(typename Traversal::State),
          .record_bytes = sizeof(RayRecord<typename Traversal::State>),
          .trace = [](const Trees& trees, std::span<const Ray> rays,
                      std::span<SeedHit> hits) { trace_rays<Traversal, false>(trees, rays, hits); },
          .count = &trace_rays<Traversal, true>};
}

template <unsigned N>
void add_wide(std::vector<Algorithm>& list) {
  list.push_back(algorithm_of<Stack<N>>());
  list.push_back(algorithm_of<Stackless<N, TableCodes<N>>>());
  list.push_back(algorithm_of<Stackless<N, ArithmeticCodes<N>>>());
}

inline std::vector<Algorithm> all_algorithms() {
  std::vector<Algorithm> list;
  add_wide<2>(list);
  list.push_back(algorithm_of<RestartTrail>());
  list.push_back(algorithm_of<SkipPointers>());
  list.push_back(algorithm_of<ParentPointers>());
  add_wide<4>(list);
  add_wide<8>(list);
  add_wide<16>(list);
  return list;
}

}  // namespace raymill::bench::RAYMILL_ISA
