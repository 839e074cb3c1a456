// The floating-point mode of a thread: rounding to nearest, denormals kept, exceptions masked.
#pragma once

#if defined(__SSE__)
#include <xmmintrin.h>
#endif

namespace raymill::traversal {

/// Sets the mode for this thread until the scope ends, then puts the caller's back. Threads inherit FTZ and DAZ from
/// whoever starts them, and callers may run with them; answers must not depend on that.
class IeeeScope {
 public:
#if defined(__SSE__)
  IeeeScope() : before_(_mm_getcsr()) { _mm_setcsr(kDefaultControl); }
  ~IeeeScope() { _mm_setcsr(before_); }
#else
  IeeeScope() = default;
#endif
  IeeeScope(const IeeeScope&) = delete;
  IeeeScope& operator=(const IeeeScope&) = delete;

 private:
#if defined(__SSE__)
  static constexpr unsigned kDefaultControl = 0x1F80;
  const unsigned before_;
#endif
};

}  // namespace raymill::traversal
