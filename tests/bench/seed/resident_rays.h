// How many rays that are set aside fit a size of memory, by the growth of the process.
#pragma once

#include <cstdint>

#include "storage/base/status.h"
#include "tests/bench/seed/kernels.h"

namespace raymill::bench {

constexpr std::uint64_t kResidentBytes = 128U << 20;

struct ResidentRays {
  std::uint64_t grown_bytes = 0;  ///< of the resident set, for as many records as kResidentBytes should hold
  double rays = 0;                ///< that kResidentBytes of growth hold
};

/// Writes an array of the algorithm's records and looks at /proc/self/statm. Errors: io.
Result<ResidentRays> measure_resident_rays(const Algorithm& algorithm);

}  // namespace raymill::bench
