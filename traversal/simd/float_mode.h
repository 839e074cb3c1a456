// The floating-point mode of a thread: rounding to nearest, denormals kept, exceptions masked.
#pragma once

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace raymill::traversal {

/// Threads inherit FTZ and DAZ from whoever starts them; answers must not depend on that.
inline void use_ieee_arithmetic() {
#if defined(__SSE__)
  constexpr unsigned kDefaultControl = 0x1F80;
  _mm_setcsr(kDefaultControl);
#endif
}

}  // namespace raymill::traversal
