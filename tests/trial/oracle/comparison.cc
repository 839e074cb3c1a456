#include "tests/trial/oracle/comparison.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <tuple>

namespace raymill::trial {
namespace {

bool is_invalid(const Ray& ray) {
  bool finite = true, zero = true;
  for (int axis = 0; axis < 3; ++axis) {
    finite &= std::isfinite(ray.org[axis]) && std::isfinite(ray.dir[axis]);
    zero &= ray.dir[axis] == 0;
  }
  return !finite || zero || !(ray.tnear <= ray.tfar);
}

}  // namespace

Comparison::Comparison(std::span<const storage::Triangle> triangles, const EmbreePeer& peer, const Reference& reference)
    : triangles_(triangles), peer_(peer), reference_(reference), by_id_(triangles.size()) {
  std::iota(by_id_.begin(), by_id_.end(), 0U);
  std::ranges::sort(by_id_, {},
                    [&](std::uint32_t i) { return std::tuple(triangles_[i].geometry_id, triangles_[i].primitive_id); });
}

std::optional<std::uint32_t> Comparison::find(std::uint32_t geometry_id, std::uint32_t primitive_id) const {
  const auto at = std::ranges::lower_bound(by_id_, std::tuple(geometry_id, primitive_id), {}, [&](std::uint32_t i) {
    return std::tuple(triangles_[i].geometry_id, triangles_[i].primitive_id);
  });
  if (at == by_id_.end() || triangles_[*at].geometry_id != geometry_id ||
      triangles_[*at].primitive_id != primitive_id) {
    return std::nullopt;
  }
  return *at;
}

std::string Comparison::describe(const std::optional<Candidate>& candidate) const {
  if (!candidate) {
    return "miss";
  }
  const storage::Triangle& triangle = triangles_[candidate->triangle];
  std::ostringstream out;
  out.precision(12);
  out << "geometry " << triangle.geometry_id << " triangle " << triangle.primitive_id;
  if (candidate->meeting.possible()) {
    out << " t " << double(candidate->meeting.t);
  } else {
    out << " (not met)";
  }
  return out.str();
}

void Comparison::measure(std::uint64_t number, const Hit& ours, const Candidate& candidate, Tally& tally) const {
  if (!candidate.meeting.possible()) {
    return;
  }
  // Of a t near zero float64 itself keeps few digits: what it cannot know is no fault.
  const double t = double(candidate.meeting.t), off_by = double(magnitude(Quad(ours.t) - candidate.meeting.t));
  tally.add_t(number, std::max(0.0, off_by - candidate.meeting.t_error) / ulp32(t));
  const double off = std::max(double(magnitude(Quad(ours.u) - candidate.meeting.u)),
                              double(magnitude(Quad(ours.v) - candidate.meeting.v)));
  tally.max_barycentric_error = std::max(tally.max_barycentric_error, off);
}

void Comparison::closest(std::uint64_t number, const Ray& ray, const Hit& ours, Tally& tally) const {
  ++tally.rays;
  Disagreement row;
  row.ray = number;
  if (is_invalid(ray) || std::isnan(ours.t)) {
    const bool agree = is_invalid(ray) && std::isnan(ours.t);
    tally.invalid += agree;
    row.outcome = agree ? Outcome::agrees : Outcome::bad_row;
    tally.add(std::move(row));
    return;
  }
  const bool is_hit = std::isfinite(ours.t);
  tally.hits += is_hit;
  std::optional<Candidate> mine, peers;
  if (is_hit) {
    const auto triangle = find(ours.geometry_id, ours.primitive_id);
    if (!triangle) {
      row.outcome = Outcome::bad_row;
      row.ours = "geometry " + std::to_string(ours.geometry_id) + " triangle " + std::to_string(ours.primitive_id) +
                 ", which the scene lacks";
      tally.add(std::move(row));
      return;
    }
    mine = reference_.judge(ray, *triangle);
    measure(number, ours, *mine, tally);
  }
  if (const auto triangle = peer_.closest(ray)) {
    peers = reference_.judge(ray, *triangle);
  }
  std::vector<Candidate> found;
  reference_.collect(ray, found);
  const Truth truth = truth_of(found);
  row.ours_verdict = judge_answer(truth, mine);
  row.embree_verdict = judge_answer(truth, peers);
  const bool same_kind = mine.has_value() == peers.has_value();
  tally.hit_or_miss_differs += !same_kind;
  if (same_kind && (!mine || mine->triangle == peers->triangle)) {
    row.outcome = row.ours_verdict == Verdict::wrong ? Outcome::both_wrong : Outcome::agrees;
  } else if (row.ours_verdict == Verdict::wrong) {
    row.outcome = Outcome::decided_against;
  } else if (same_kind && row.embree_verdict != Verdict::wrong &&
             static_cast<float>(mine->meeting.t) == static_cast<float>(peers->meeting.t)) {
    row.outcome = Outcome::same_t;
  } else if (row.ours_verdict == Verdict::right && row.embree_verdict != Verdict::right) {
    row.outcome = Outcome::decided_for;
  } else {
    row.outcome = Outcome::float64_cannot_tell;
  }
  if (row.outcome != Outcome::agrees) {
    row.ours = describe(mine);
    row.embree = describe(peers);
    row.reference = describe(truth.first != nullptr ? std::optional(*truth.first) : std::nullopt);
  }
  tally.add(std::move(row));
}

void Comparison::any(std::uint64_t number, const Ray& ray, const Hit& ours, Tally& tally) const {
  ++tally.rays;
  Disagreement row;
  row.ray = number;
  const bool invalid = is_invalid(ray);
  if (invalid ? !std::isnan(ours.t) : ours.t != 0 && ours.t != INFINITY) {
    row.outcome = Outcome::bad_row;
    tally.add(std::move(row));
    return;
  }
  if (invalid) {
    ++tally.invalid;
    tally.add(std::move(row));
    return;
  }
  const bool is_hit = ours.t == 0, peer_hit = peer_.any(ray);
  tally.hits += is_hit;
  tally.hit_or_miss_differs += is_hit != peer_hit;
  std::vector<Candidate> found;
  reference_.collect(ray, found);
  const Truth truth = truth_of(found);
  const auto judge = [&](bool hit) {
    if (!hit) {
      return judge_answer(truth, std::nullopt);
    }
    return truth.first != nullptr ? Verdict::right : found.empty() ? Verdict::wrong : Verdict::near;
  };
  row.ours_verdict = judge(is_hit);
  row.embree_verdict = judge(peer_hit);
  if (is_hit == peer_hit) {
    row.outcome = row.ours_verdict == Verdict::wrong ? Outcome::both_wrong : Outcome::agrees;
  } else {
    row.outcome = row.ours_verdict == Verdict::wrong   ? Outcome::decided_against
                  : row.ours_verdict == Verdict::right ? Outcome::decided_for
                                                       : Outcome::float64_cannot_tell;
  }
  row.ours = is_hit ? "hit" : "miss";
  row.embree = peer_hit ? "hit" : "miss";
  row.reference = describe(truth.first != nullptr ? std::optional(*truth.first) : std::nullopt);
  tally.add(std::move(row));
}

}  // namespace raymill::trial
