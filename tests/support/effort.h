// How much a test does. Sanitized code runs at a fifth of its speed and without optimisation: what comes in great
// numbers there comes in fewer, and of what is combined with everything each value comes once.
#pragma once

namespace raymill::tests {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

}  // namespace raymill::tests
