#include "traversal/kernel.h"

namespace raymill::traversal {

std::string_view to_string(Isa isa) {
  switch (isa) {
    case Isa::avx512:
      return "avx512";
    case Isa::avx2:
      return "avx2";
    default:
      return "scalar";
  }
}

std::vector<Isa> runnable_isas() {
  std::vector<Isa> isas;
#if defined(__x86_64__)
#if !defined(RAYMILL_WITHOUT_AVX512)
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512vbmi");
  if (avx512) {
    isas.push_back(Isa::avx512);
  }
#endif
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("lzcnt")) {
    isas.push_back(Isa::avx2);
  }
#endif
  isas.push_back(Isa::scalar);
  return isas;
}

Kernel find_kernel(Isa isa, const KernelChoice& choice) {
#if defined(__x86_64__)
#if !defined(RAYMILL_WITHOUT_AVX512)
  if (isa == Isa::avx512) {
    return avx512::find_kernel(choice);
  }
#endif
  if (isa == Isa::avx2) {
    return avx2::find_kernel(choice);
  }
#endif
  return scalar::find_kernel(choice);
}

ExpandedKernel find_expanded_kernel(Isa isa, const KernelChoice& choice) {
#if defined(__x86_64__)
#if !defined(RAYMILL_WITHOUT_AVX512)
  if (isa == Isa::avx512) {
    return avx512::find_expanded_kernel(choice);
  }
#endif
  if (isa == Isa::avx2) {
    return avx2::find_expanded_kernel(choice);
  }
#endif
  return scalar::find_expanded_kernel(choice);
}

}  // namespace raymill::traversal
