// The kernels for scalar; see kernel-inl.h.
#define RAYMILL_ISA scalar
#include "traversal/kernels/kernel-inl.h"
#include "traversal/simd/scalar.h"

namespace raymill::traversal::scalar {

Kernel find_kernel(const KernelChoice& choice) { return select_kernel(choice); }

}  // namespace raymill::traversal::scalar
