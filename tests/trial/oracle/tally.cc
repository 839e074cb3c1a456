#include "tests/trial/oracle/tally.h"

#include <algorithm>
#include <sstream>
#include <utility>

namespace raymill::trial {
namespace {

constexpr double kMaxUlp = 4;
constexpr std::size_t kMostPrinted = 100;

}  // namespace

const char* to_string(Outcome outcome) {
  switch (outcome) {
    case Outcome::agrees:
      return "agrees";
    case Outcome::same_t:
      return "same_t";
    case Outcome::decided_for:
      return "decided_for";
    case Outcome::float64_cannot_tell:
      return "float64_cannot_tell";
    case Outcome::decided_against:
      return "decided_against";
    case Outcome::both_wrong:
      return "both_wrong";
    case Outcome::bad_row:
      return "bad_row";
    case Outcome::count:
      break;
  }
  return "";
}

bool fails(Outcome outcome) {
  return outcome == Outcome::decided_against || outcome == Outcome::both_wrong || outcome == Outcome::bad_row;
}

void Tally::add(Disagreement disagreement) {
  ++outcomes[static_cast<std::size_t>(disagreement.outcome)];
  if (disagreement.outcome != Outcome::agrees && disagreement.outcome != Outcome::same_t && list.size() < kMaxList) {
    list.push_back(std::move(disagreement));
  }
}

void Tally::add_t(std::uint64_t ray, double ulp) {
  over_half_ulp += ulp > 0.5;
  over_four_ulp += !(ulp <= kMaxUlp);
  if (!(ulp <= max_ulp)) {
    max_ulp = ulp;
    worst_ray = ray;
  }
}

void Tally::merge(Tally other) {
  rays += other.rays;
  hits += other.hits;
  invalid += other.invalid;
  hit_or_miss_differs += other.hit_or_miss_differs;
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    outcomes[i] += other.outcomes[i];
  }
  over_half_ulp += other.over_half_ulp;
  over_four_ulp += other.over_four_ulp;
  if (!(other.max_ulp <= max_ulp)) {
    max_ulp = other.max_ulp;
    worst_ray = other.worst_ray;
  }
  max_barycentric_error = std::max(max_barycentric_error, other.max_barycentric_error);
  for (Disagreement& disagreement : other.list) {
    if (list.size() < kMaxList) {
      list.push_back(std::move(disagreement));
    }
  }
  std::ranges::sort(list, {}, &Disagreement::ray);
}

bool Tally::passed() const {
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    if (fails(static_cast<Outcome>(i)) && outcomes[i] > 0) {
      return false;
    }
  }
  return over_four_ulp == 0;
}

nlohmann::json Tally::json() const {
  nlohmann::json out = {{"rays", rays},
                        {"hits", hits},
                        {"invalid", invalid},
                        {"hit_or_miss_differs", hit_or_miss_differs},
                        {"max_ulp", max_ulp},
                        {"over_half_ulp", over_half_ulp},
                        {"over_four_ulp", over_four_ulp},
                        {"worst_ray", worst_ray},
                        {"max_barycentric_error", max_barycentric_error},
                        {"passed", passed()}};
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    out[to_string(static_cast<Outcome>(i))] = outcomes[i];
  }
  nlohmann::json& rows = out["list"] = nlohmann::json::array();
  for (const Disagreement& d : list) {
    rows.push_back({{"ray", d.ray},
                    {"outcome", to_string(d.outcome)},
                    {"ours", d.ours},
                    {"ours_is", to_string(d.ours_verdict)},
                    {"embree", d.embree},
                    {"embree_is", to_string(d.embree_verdict)},
                    {"reference", d.reference}});
  }
  return out;
}

std::string Tally::text() const {
  std::ostringstream out;
  out << rays << " rays, " << hits << " hits, " << invalid << " invalid\n";
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    out << "  " << to_string(static_cast<Outcome>(i)) << ": " << outcomes[i] << "\n";
  }
  out << "  t: at most " << max_ulp << " ulp off (ray " << worst_ray << "), " << over_half_ulp << " over half an ulp, "
      << over_four_ulp << " over four\n  u, v: at most " << max_barycentric_error << " off\n";
  for (std::size_t i = 0; i < std::min(list.size(), kMostPrinted); ++i) {
    const Disagreement& d = list[i];
    out << "ray " << d.ray << ": " << to_string(d.outcome) << "; ours: " << d.ours << " (" << to_string(d.ours_verdict)
        << "); Embree: " << d.embree << " (" << to_string(d.embree_verdict) << "); exact: " << d.reference << "\n";
  }
  if (list.size() > kMostPrinted) {
    out << "... and " << list.size() - kMostPrinted << " more; --json lists them\n";
  }
  out << (passed() ? "passed\n" : "FAILED\n");
  return out.str();
}

}  // namespace raymill::trial
