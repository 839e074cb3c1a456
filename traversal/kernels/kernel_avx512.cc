// The kernels for avx512; see kernel-inl.h.
#define RAYMILL_ISA avx512
#include "traversal/simd/avx512.h"
// The lanes come first: what follows is written on them.
#include "traversal/kernels/expanded-inl.h"
#include "traversal/kernels/kernel_choice-inl.h"

namespace raymill::traversal::avx512 {

Kernel find_kernel(const KernelChoice& choice) { return select_kernel(choice); }
ExpandedKernel find_expanded_kernel(const KernelChoice& choice) { return select_expanded_kernel(choice); }

}  // namespace raymill::traversal::avx512
