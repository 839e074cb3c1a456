// Verdict: whether an answer to a ray is right, by the reference alone.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "tests/trial/oracle/reference.h"

namespace raymill::trial {

enum class Verdict : std::uint8_t {
  right,  ///< the hit or miss of exact arithmetic; among hits of equal float32 t any
  near,   ///< differs from exact arithmetic where float64 cannot tell: at an edge, an end of the interval, an equal t
  wrong,
};
const char* to_string(Verdict verdict);

/// The truth about one ray.
struct Truth {
  const Candidate* first = nullptr;    ///< the hit of exact arithmetic; null: a miss
  const Candidate* certain = nullptr;  ///< the first hit that float64 cannot doubt
};
Truth truth_of(const std::vector<Candidate>& found);

/// Judges the hit of `candidate`, or a miss where it is empty.
Verdict judge_answer(const Truth& truth, const std::optional<Candidate>& candidate);

}  // namespace raymill::trial
