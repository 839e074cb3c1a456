// The lanes of avx2. Include only from a translation unit that is compiled for AVX2 and defines RAYMILL_ISA.
#pragma once

#include "traversal/simd/x86-inl.h"
// The lanes come first: what follows is written on them.
#include "traversal/simd/near_far-inl.h"

namespace raymill::traversal::avx2 {

/// See simd/scalar.h.
inline void corner_indices(const std::uint16_t* indices, unsigned count,
                           std::array<std::array<std::int32_t, 8>, 3>& index) {
  for (unsigned i = 0; i < 8; ++i) {
    const unsigned from = i < count ? i : 0;
    for (unsigned k = 0; k < 3; ++k) {
      index[k][i] = indices[from * 3 + k] * 3;
    }
  }
}

}  // namespace raymill::traversal::avx2
