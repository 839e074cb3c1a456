// The algorithms for any machine; see kernels-inl.h.
#define RAYMILL_ISA scalar
#include "traversal/simd/scalar.h"
// The lanes come first: what follows is written on them.
#include "tests/bench/seed/kernels-inl.h"

namespace raymill::bench::scalar {

std::vector<Algorithm> algorithms() { return all_algorithms(); }

Algorithm brute_force() { return algorithm_of<BruteForce>(); }

}  // namespace raymill::bench::scalar
