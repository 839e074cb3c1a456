// The oracle: every triangle for every ray in long double, by Moeller and Trumbore's algebra on exact differences. It
// shares no code with the kernels, and says where it is too close to an edge to know. Immutable values.
#pragma once

#include <span>
#include <vector>

#include "storage/base/vec3.h"
#include "traversal/query.h"

namespace raymill::tests {

struct OracleHit {
  const storage::Triangle* triangle = nullptr;
  long double t = 0, u = 0, v = 0;
  bool certain = false;  ///< well inside the triangle and the interval
};

/// Hits of a ray by t, those that may or may not be hits included.
std::vector<OracleHit> oracle_hits(std::span<const storage::Triangle> triangles, const Ray& ray);

/// Empty where `hit` is an answer that the oracle can agree with, else what is wrong. `t_ulps`: how far t may be off.
std::string oracle_objects(std::span<const storage::Triangle> triangles, const Ray& ray, const Hit& hit,
                           double t_ulps = 4);

}  // namespace raymill::tests
