// What a mode's hits are worth beside the oracle's: counts, and how the errors of t are spread.
//
// An answer is a hit or a miss; an error of t is looked at where both hit. A hit of another primitive at the very t of
// the oracle's is as good: at an edge several triangles are met at once.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <type_traits>

#include "traversal/query.h"

namespace raymill::client {

/// The oracle's answer to a ray, and the length of its dir.
struct Truth {
  float t = 0;  ///< +inf: a miss; NaN: the ray is invalid
  std::uint32_t geometry_id = kNoId;
  std::uint32_t primitive_id = kNoId;
  float dir_length = 1;
};
static_assert(sizeof(Truth) == 16 && std::is_trivially_copyable_v<Truth>);

Truth truth_of(const Ray& ray, const Hit& hit);

/// Whether a ray without an end surely began inside a closed mesh whose triangles face outwards: `hit`, the oracle's
/// with Field::normal, met a triangle from behind, clear of its edges and of where the ray begins.
bool begins_inside(const Ray& ray, const Hit& hit);

/// Steps from one float32 to the other; -0 and +0 are the same.
std::uint64_t ulps_between(float a, float b);

/// Values from 0 up, counted in steps of less than 1 %: whole numbers up to 256 are told exactly. Thread-confined.
class Spread {
 public:
  void add(double value);
  [[nodiscard]] std::uint64_t count() const { return count_; }
  /// A value that `share` of them do not exceed, at most 1 % larger than the least such; 0 where there is none.
  [[nodiscard]] double at(double share) const;
  [[nodiscard]] double most() const { return most_; }

 private:
  struct Step {
    std::uint64_t count = 0;
    double most = 0;
  };
  std::map<std::uint32_t, Step> steps_;
  std::uint64_t count_ = 0;
  double most_ = 0;
};

/// Thread-confined.
class Tally {
 public:
  /// `inside`: as begins_inside() says of the store's own oracle. `bound`: the error that the setting allows, in scene
  /// units; a hit that is off by more lies on another surface than the oracle's.
  void add(const Truth& truth, const Hit& hit, bool inside, double bound = std::numeric_limits<double>::infinity());

  [[nodiscard]] std::uint64_t rays() const { return rays_; }  ///< all, the invalid ones too
  [[nodiscard]] std::uint64_t invalid() const { return invalid_; }
  [[nodiscard]] std::uint64_t oracle_hits() const { return oracle_hits_; }
  [[nodiscard]] std::uint64_t wrong_misses() const { return wrong_misses_; }  ///< the oracle hits
  [[nodiscard]] std::uint64_t wrong_hits() const { return wrong_hits_; }      ///< the oracle misses
  /// Of hits of both, another primitive at another t.
  [[nodiscard]] std::uint64_t wrong_primitives() const { return wrong_primitives_; }
  /// Of hits of both, those off by more than the bound: a subtree's proxy was taken for hit that the ray passes, or the
  /// other way, and something else stands behind it. They are no part of the errors of t.
  [[nodiscard]] std::uint64_t wrong_surfaces() const { return wrong_surfaces_; }
  [[nodiscard]] std::uint64_t proxy_hits() const { return proxy_hits_; }  ///< hits that proxies gave; where uv is asked
  [[nodiscard]] std::uint64_t inside() const { return inside_; }
  [[nodiscard]] std::uint64_t leaks() const { return leaks_; }      ///< misses of rays that begin inside
  [[nodiscard]] const Spread& t_ulps() const { return t_ulps_; }    ///< where both hit
  [[nodiscard]] const Spread& t_units() const { return t_units_; }  ///< the same, in scene units: times |dir|

 private:
  std::uint64_t rays_ = 0, invalid_ = 0, oracle_hits_ = 0;
  std::uint64_t wrong_misses_ = 0, wrong_hits_ = 0, wrong_primitives_ = 0, wrong_surfaces_ = 0, proxy_hits_ = 0;
  std::uint64_t inside_ = 0, leaks_ = 0;
  Spread t_ulps_, t_units_;
};

}  // namespace raymill::client
