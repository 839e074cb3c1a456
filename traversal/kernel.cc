#include "traversal/kernel.h"

namespace raymill::traversal {

std::string_view to_string(Isa isa) { return isa == Isa::avx2 ? "avx2" : "scalar"; }

std::vector<Isa> runnable_isas() {
  std::vector<Isa> isas;
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("lzcnt")) {
    isas.push_back(Isa::avx2);
  }
#endif
  isas.push_back(Isa::scalar);
  return isas;
}

Kernel find_kernel(Isa isa, const KernelChoice& choice) {
#if defined(__x86_64__)
  if (isa == Isa::avx2) {
    return avx2::find_kernel(choice);
  }
#endif
  return scalar::find_kernel(choice);
}

}  // namespace raymill::traversal
