// Where a ray is in fog that is denser than a threshold. Stateless, but for the span in hand.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

#include "traversal/volume/brick_cells.h"
#include "traversal/volume/level_set.h"

namespace raymill::traversal {

/// The span that a ray is in, or has left and may yet come back to: spans that touch, rounded to float32, are one, so
/// none ends where a brick does. 8 bytes in a waiting ray, all 0 where there is none. A value.
class SpanInHand {
 public:
  SpanInHand() = default;
  explicit SpanInHand(std::uint64_t bits)
      : begin_(std::bit_cast<float>(static_cast<std::uint32_t>(bits >> 32) ^ kNoBegin)),
        end_(std::bit_cast<float>(static_cast<std::uint32_t>(bits))) {}
  [[nodiscard]] std::uint64_t bits() const {
    return std::uint64_t(std::bit_cast<std::uint32_t>(begin_) ^ kNoBegin) << 32 | std::bit_cast<std::uint32_t>(end_);
  }

  [[nodiscard]] bool exists() const { return begin_ == begin_; }
  [[nodiscard]] bool is_open() const { return exists() && end_ == kOpen; }
  [[nodiscard]] float begin() const { return begin_; }
  [[nodiscard]] float end() const { return end_; }

  /// The ray is inside from t on, which rises from call to call. False: a span was left before; take it, then ask
  /// again.
  bool enter(float t) {
    if (exists() && t > end_) {
      return false;
    }
    begin_ = exists() ? begin_ : t;
    end_ = kOpen;
    return true;
  }
  /// The ray is outside from t on.
  void leave(float t) { end_ = is_open() ? std::max(begin_, t) : end_; }

 private:
  static constexpr float kOpen = std::numeric_limits<float>::infinity();  // no t is: tfar is finite in flight
  static constexpr std::uint32_t kNoBegin = 0x7FC00000;                   // NaN
  float begin_ = std::bit_cast<float>(kNoBegin);
  float end_ = 0;
};

/// Calls side(is_above, t) at the ray's entry into each cell of the brick and where the trilinear field passes the
/// threshold inside: the roots of its cubic along the ray. A field that equals the threshold is not above it.
template <typename Side>
void each_side(const BrickCells& cells, const Interval& in, double threshold, Side&& side) {
  cells.each(in, [&](const Cell& cell, double begin, double end) {
    auto corners = cells.corners(cell);
    for (double& value : corners) {
      value = threshold - value;  // its sign is exact
    }
    const auto [least, most] = std::minmax_element(corners.begin(), corners.end());
    if (side_of(*least) == side_of(*most)) {
      side(*least < 0, begin);
      return true;
    }
    const auto from = cells.place(cell, begin), to = cells.place(cell, end);
    const auto cubic = TrilinearCell(corners).along(from, {to[0] - from[0], to[1] - from[1], to[2] - from[2]});
    bool above = cubic[0] < 0;
    side(above, begin);
    for (const double s : changes_of(cubic)) {
      if (s <= 1) {
        above = !above;
        side(above, begin + s * (end - begin));
      }
    }
    return true;
  });
}

}  // namespace raymill::traversal
