// Answers a row in every way that must not matter, beside Embree and float64. Thread-confined.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "tests/extremes/row.h"

namespace raymill::extremes {

/// What a row came to, in words.
struct Told {
  std::array<std::string, 3> modes;   ///< fast, watertight, exact
  std::array<std::string, 2> embree;  ///< default, robust
  std::string truth;
  std::vector<std::string> problems;  ///< what is not as promised, or not the same bits in every way
};

/// The row's store in core on every ISA of this machine, with two threads and the least memory, with one page there at
/// a time, and suspended at every node; then Embree on the same triangles, and float64 for as many rays as are soon
/// done. `openvdb`: the program that asks OpenVDB (raymill-volume-oracle); empty: it is not asked.
Told run(const Row& row, const std::string& openvdb);

}  // namespace raymill::extremes
