// What mode exact asks of the box tests, compiled once per ISA: that no box is culled which holds a hit.
//
// The other modes clamp t into the interval of the triangle's own box, so that no t lies outside of what the slab test
// computes. Here t is that of exact arithmetic, and the slab test has to give way. An axis' entry and exit are
// (plane - org) * rdir with three roundings, so each is off from the exact x by at most 2^-22 |x|, or by 2^-150 more
// where the product is denormal, as long as plane - org is finite and rdir has all its digits:
//   halves     everything counts in two lengths of dir: no t reaches into what overflows then, so an infinite entry is
//              beyond every tfar and an exit of -inf before every tnear, be it from a product or from a component of
//              dir that is zero.
//   reliable   an axis where the above could fail gives no constraint (NaN, slab.h). |plane| < 2^126 in every store
//              (kPositionLimit), so plane - org is finite where |org| <= 2^126; 1 / 2 dir is finite and not denormal
//              where 2^-128 < |dir| <= 2^125. With dir zero it is an infinity, and plane - org has the exact sign: org
//              is inside the slab or not.
//   end        a box is culled by its entry only beyond tfar + 2^-21 |tfar| + 2^-126. A hit has t <= tfar, or t <= tfar
//              plus half an ulp (2^-24 |tfar|) where tfar is the rounded t of the best hit. It lies in the box, so each
//              entry is at most t + 2^-22 |t| + 2^-150, which is less.
//   exit pad   the slab test's 2^-21 |exit|, and 2^-126 more: an exit is at least t - 2^-22 |t| - 2^-150, so it stays
//              above all entries, and above tnear - 2^-126.
// The pads are rounded, as the entries are, and rounding is monotone. Above 2^-110 the relative part is more than the
// errors, below it 2^-126 is. So whatever order, width, page cut or schedule, every triangle with a hit is tested, and
// the best of them is the answer.
#pragma once

#include <cmath>

#include "traversal/exact_triangle.h"
#include "traversal/kernels/triangle-inl.h"

namespace raymill::traversal::RAYMILL_ISA {

constexpr float kExactSlack = 0x1p-126F;

/// Where boxes begin to count, and up to where they are entered.
template <Mode kMode>
inline float begin_of(float tnear) {
  return kMode == Mode::exact ? 0.5F * tnear - kExactSlack : tnear;
}
template <Mode kMode>
inline float end_of(float tfar) {
  return kMode == Mode::exact ? 0.5F * tfar + (std::fabs(0.5F * tfar) * kExitPad + kExactSlack) : tfar;
}

/// Makes the frame's box tests count in halves and takes the constraint of axes away that are not reliable.
inline void prepare_exact_boxes(RayFrame& frame) {
  for (int axis = 0; axis < 3; ++axis) {
    const float org = std::fabs(frame.org[axis]), dir = std::fabs(frame.dir[axis]);
    const bool reliable = dir == 0 || (org <= 0x1p126F && dir > 0x1p-128F && dir <= 0x1p125F);
    frame.rdir[axis] = reliable ? 0.5F * frame.rdir[axis] : NAN;
  }
}

/// The decision; `tfar_is_hit` as in ExactInterval.
template <Query kQuery>
bool exact_decide(const RayFrame& frame, const Corners& corners, const ExactInterval& interval, Candidate& hit) {
  ExactHit exact;
  constexpr auto* decide = kQuery == Query::all ? &exact_crossing : &exact_hit;
  if (!decide({frame.org, frame.dir}, corners, interval, exact)) {
    return false;
  }
  hit = {exact.t, exact.u, exact.v};
  return true;
}

}  // namespace raymill::traversal::RAYMILL_ISA
