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

// Builds under sanitizers leave some out (CMakeLists.txt).
#if defined(__x86_64__) && !defined(RAYMILL_WITHOUT_AVX512)
#define RAYMILL_HAS_AVX512
#endif
#if defined(__x86_64__) && !defined(RAYMILL_WITHOUT_AVX2)
#define RAYMILL_HAS_AVX2
#endif
#if !defined(RAYMILL_WITHOUT_SCALAR)
#define RAYMILL_HAS_SCALAR
#endif

std::vector<Isa> runnable_isas() {
  std::vector<Isa> isas;
#if defined(RAYMILL_HAS_AVX512)
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
                      __builtin_cpu_supports("avx512vbmi");
  if (avx512) {
    isas.push_back(Isa::avx512);
  }
#endif
#if defined(RAYMILL_HAS_AVX2)
  if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("lzcnt")) {
    isas.push_back(Isa::avx2);
  }
#endif
#if defined(RAYMILL_HAS_SCALAR)
  isas.push_back(Isa::scalar);
#endif
  return isas;
}

namespace {

struct Finders {
  Kernel (*kernel)(const KernelChoice& choice) = nullptr;
  ExpandedKernel (*expanded)(const KernelChoice& choice) = nullptr;
};

Finders finders_of(Isa isa) {
  switch (isa) {
#if defined(RAYMILL_HAS_AVX512)
    case Isa::avx512:
      return {avx512::find_kernel, avx512::find_expanded_kernel};
#endif
#if defined(RAYMILL_HAS_AVX2)
    case Isa::avx2:
      return {avx2::find_kernel, avx2::find_expanded_kernel};
#endif
#if defined(RAYMILL_HAS_SCALAR)
    case Isa::scalar:
      return {scalar::find_kernel, scalar::find_expanded_kernel};
#endif
    default:
      return {};
  }
}

}  // namespace

Kernel find_kernel(Isa isa, const KernelChoice& choice) {
  const auto find = finders_of(isa).kernel;
  return find != nullptr ? find(choice) : nullptr;
}

ExpandedKernel find_expanded_kernel(Isa isa, const KernelChoice& choice) {
  const auto find = finders_of(isa).expanded;
  return find != nullptr ? find(choice) : nullptr;
}

}  // namespace raymill::traversal
