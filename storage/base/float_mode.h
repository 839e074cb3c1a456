// The floating-point mode of a thread: rounding to nearest, denormals kept, exceptions masked.
// traversal/simd/float_mode.h does the same where it is done for every batch.
#pragma once

#include <cfenv>

namespace raymill::storage {

/// Sets the mode for this thread, and for threads and arenas that it starts meanwhile, until the scope ends; then puts
/// the caller's back. Callers may run with FTZ and DAZ; what is built must not depend on that.
class DefaultFloatMode {
 public:
  DefaultFloatMode() {
    (void)std::fegetenv(&before_);
    (void)std::fesetenv(FE_DFL_ENV);
  }
  ~DefaultFloatMode() { (void)std::fesetenv(&before_); }
  DefaultFloatMode(const DefaultFloatMode&) = delete;
  DefaultFloatMode& operator=(const DefaultFloatMode&) = delete;

 private:
  std::fenv_t before_{};
};

}  // namespace raymill::storage
