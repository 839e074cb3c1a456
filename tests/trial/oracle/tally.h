// Tally: what came of the comparison of all rays. Plain values; thread-confined, merged at the end.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/trial/oracle/verdict.h"

namespace raymill::trial {

/// How an answer relates to Embree's and to the reference.
enum class Outcome : std::uint8_t {
  agrees,               ///< the same triangle, or both a miss, and the reference does not object
  same_t,               ///< two triangles at the same float32 t, both hit
  decided_for,          ///< differs from Embree; ours is right
  float64_cannot_tell,  ///< differs from Embree by less than float64 can tell
  decided_against,      ///< differs from Embree; ours is wrong
  both_wrong,           ///< agrees with Embree; the reference says otherwise
  bad_row,              ///< ids that no triangle has, a NaN for a valid ray or none for an invalid one
  count
};
const char* to_string(Outcome outcome);
/// Whether the trial fails on it.
bool fails(Outcome outcome);

struct Disagreement {
  std::uint64_t ray = 0;
  Outcome outcome = Outcome::agrees;
  std::string ours, embree, reference;  ///< "geometry 3 triangle 17 t 0.25" or "miss"
  Verdict ours_verdict = Verdict::right, embree_verdict = Verdict::right;
};

struct Tally {
  std::uint64_t rays = 0;
  std::uint64_t hits = 0;
  std::uint64_t invalid = 0;
  std::uint64_t hit_or_miss_differs = 0;  ///< from Embree's
  std::array<std::uint64_t, static_cast<std::size_t>(Outcome::count)> outcomes{};
  double max_ulp = 0;  ///< of t, against exact arithmetic for the same triangle, beyond float64's own error
  std::uint64_t over_half_ulp = 0;
  std::uint64_t over_four_ulp = 0;
  std::uint64_t worst_ray = 0;
  double max_barycentric_error = 0;
  std::vector<Disagreement> list;  ///< whatever does not agree; at most kMaxList

  static constexpr std::size_t kMaxList = 10000;

  void add(Disagreement disagreement);
  void add_t(std::uint64_t ray, double ulp);
  void merge(Tally other);
  [[nodiscard]] std::uint64_t count(Outcome outcome) const { return outcomes[static_cast<std::size_t>(outcome)]; }
  [[nodiscard]] bool passed() const;
  [[nodiscard]] nlohmann::json json() const;
  [[nodiscard]] std::string text() const;
};

}  // namespace raymill::trial
