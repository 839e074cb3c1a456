// The kernels for scalar; see kernel-inl.h.
#define RAYMILL_ISA scalar
#include "traversal/simd/scalar.h"
// The lanes come first: what follows is written on them.
#include "traversal/kernels/expanded-inl.h"
#include "traversal/kernels/kernel_choice-inl.h"

namespace raymill::traversal::scalar {

Kernel find_kernel(const KernelChoice& choice) { return select_kernel(choice); }
ExpandedKernel find_expanded_kernel(const KernelChoice& choice) { return select_expanded_kernel(choice); }

}  // namespace raymill::traversal::scalar
