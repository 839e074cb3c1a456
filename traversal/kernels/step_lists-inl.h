// StepLists: rays that take turns, by the step that each makes next. Compiled once per ISA; the includer defines
// RAYMILL_ISA.
#pragma once

#include <array>

namespace raymill::traversal::RAYMILL_ISA {

template <typename L, unsigned kCapacity, unsigned kSteps>
struct StepLists {
  std::array<std::array<L*, kCapacity>, kSteps> lanes;
  std::array<unsigned, kSteps> count{};

  void add(unsigned step, L* lane) { lanes[step][count[step]++] = lane; }
  [[nodiscard]] bool empty() const { return count == std::array<unsigned, kSteps>{}; }
  /// Empties the step's list and makes the step of each ray in it.
  template <typename Do>
  void each(unsigned step, Do&& make_step) {
    const unsigned lane_count = count[step];
    count[step] = 0;
    for (unsigned i = 0; i < lane_count; ++i) {
      make_step(lanes[step][i]);
    }
  }
};

}  // namespace raymill::traversal::RAYMILL_ISA
