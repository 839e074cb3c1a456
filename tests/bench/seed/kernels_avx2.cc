// The algorithms for avx2; see kernels-inl.h.
#define RAYMILL_ISA avx2
#include "traversal/simd/avx2.h"
// The lanes come first: what follows is written on them.
#include "tests/bench/seed/kernels-inl.h"

namespace raymill::bench::avx2 {

std::vector<Algorithm> algorithms() { return all_algorithms(); }

}  // namespace raymill::bench::avx2
