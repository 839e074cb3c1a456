// Mode exact against the rational oracle: the kernels of every ISA on a scene's pages, and the triangle test alone.
#pragma once

#include <cstdint>
#include <string>

#include "tests/exact/adversary.h"

namespace raymill::tests {

struct Compared {
  std::uint64_t rays = 0;
  std::uint64_t hits = 0;
  std::uint64_t differences = 0;
  std::string first;  ///< the first difference, in words and hexadecimal floats
};

/// A scene and `ray_count` rays of the adversary; half of those that hit are cut to end about their hit.
Compared compare_adversary(Random& random, Adversary adversary, std::size_t ray_count);

}  // namespace raymill::tests
