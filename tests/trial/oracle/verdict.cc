#include "tests/trial/oracle/verdict.h"

namespace raymill::trial {

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::right:
      return "right";
    case Verdict::near:
      return "near";
    case Verdict::wrong:
      return "wrong";
  }
  return "";
}

Truth truth_of(const std::vector<Candidate>& found) {
  Truth truth;
  for (const Candidate& candidate : found) {
    if (candidate.inside && (truth.first == nullptr || candidate.meeting.t < truth.first->meeting.t)) {
      truth.first = &candidate;
    }
    if (candidate.certain && (truth.certain == nullptr || candidate.meeting.t < truth.certain->meeting.t)) {
      truth.certain = &candidate;
    }
  }
  return truth;
}

Verdict judge_answer(const Truth& truth, const std::optional<Candidate>& candidate) {
  if (!candidate) {
    return truth.certain != nullptr ? Verdict::wrong : truth.first != nullptr ? Verdict::near : Verdict::right;
  }
  const Meeting& meeting = candidate->meeting;
  if (!meeting.possible()) {
    return Verdict::wrong;
  }
  if (truth.certain != nullptr) {
    const Meeting& certain = truth.certain->meeting;
    const double gap = double(meeting.t - certain.t);
    if (gap > 4 * ulp32(double(certain.t)) + meeting.t_error + certain.t_error) {
      return Verdict::wrong;  // something stands before it
    }
  }
  const bool first = candidate->inside && truth.first != nullptr &&
                     static_cast<float>(meeting.t) <= static_cast<float>(truth.first->meeting.t);
  return first ? Verdict::right : Verdict::near;
}

}  // namespace raymill::trial
