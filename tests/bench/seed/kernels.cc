#include "tests/bench/seed/kernels.h"

#include <algorithm>

#include "traversal/kernel.h"

namespace raymill::bench {
namespace {

bool has_avx2() {
  const auto isas = traversal::runnable_isas();
  return std::find(isas.begin(), isas.end(), traversal::Isa::avx2) != isas.end();
}

}  // namespace

std::vector<Algorithm> algorithms() { return has_avx2() ? avx2::algorithms() : scalar::algorithms(); }

Algorithm brute_force() { return scalar::brute_force(); }

std::string isa_of_algorithms() { return has_avx2() ? "avx2" : "scalar"; }

}  // namespace raymill::bench
