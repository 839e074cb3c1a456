#include "tests/bench/seed/kernels.h"

#include "traversal/kernel.h"

namespace raymill::bench {
namespace {

traversal::Isa best_isa() { return traversal::runnable_isas().front(); }

}  // namespace

std::vector<Algorithm> algorithms() {
  switch (best_isa()) {
    case traversal::Isa::avx512:
      return avx512::algorithms();
    case traversal::Isa::avx2:
      return avx2::algorithms();
    default:
      return scalar::algorithms();
  }
}

Algorithm brute_force() { return scalar::brute_force(); }

std::string isa_of_algorithms() { return std::string(to_string(best_isa())); }

}  // namespace raymill::bench
