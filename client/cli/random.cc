#include "client/cli/random.h"

#include <algorithm>
#include <bit>

namespace raymill::client {

std::uint64_t permute(std::uint64_t index, std::uint64_t count, std::uint64_t seed) {
  constexpr unsigned kRounds = 4;
  const auto half_bits = std::max(1U, (static_cast<unsigned>(std::bit_width(count - 1)) + 1) / 2);
  const std::uint64_t half_mask = (std::uint64_t{1} << half_bits) - 1;
  do {
    std::uint64_t left = index >> half_bits, right = index & half_mask;
    for (unsigned round = 0; round < kRounds; ++round) {
      const std::uint64_t next = left ^ (mix(seed, round, right) & half_mask);
      left = right;
      right = next;
    }
    index = left << half_bits | right;
  } while (index >= count);
  return index;
}

}  // namespace raymill::client
