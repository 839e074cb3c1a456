// Reference: a brute force that skips only what provably cannot matter.
//
// All triangles that a ray may meet no later than its first certain hit, found through a tree of the triangles' exact
// boxes whose slab test is float64 with a margin far above its error. It shares no code with the traversal.
// Immutable once made; thread-safe.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "storage/base/vec3.h"
#include "tests/trial/oracle/meeting.h"

namespace raymill::trial {

/// A triangle that the ray meets inside its interval, or may meet as far as float64 can tell.
struct Candidate {
  std::uint32_t triangle = 0;
  Meeting meeting;
  bool inside = false;   ///< t lies in [tnear, tfar], exactly
  bool certain = false;  ///< hit and inside, both by more than rounding
};

class Reference {
 public:
  explicit Reference(std::span<const storage::Triangle> triangles);

  /// Replaces `found` by the candidates up to the first certain one, that one included; in no order.
  void collect(const Ray& ray, std::vector<Candidate>& found) const;
  /// The meeting with one triangle, judged against the interval. Not possible(): t is void.
  [[nodiscard]] Candidate judge(const Ray& ray, std::uint32_t triangle) const;

 private:
  struct Node {
    storage::Aabb box;
    std::uint32_t first = 0;  ///< left child, the right one follows; for a leaf the place in order_
    std::uint32_t count = 0;  ///< of a leaf's triangles; 0 for an inner node
  };
  void split(std::uint32_t node, std::uint32_t first, std::uint32_t last);

  std::span<const storage::Triangle> triangles_;
  std::vector<std::uint32_t> order_;
  std::vector<Node> nodes_;
};

}  // namespace raymill::trial
