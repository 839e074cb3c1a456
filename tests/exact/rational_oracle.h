// The oracle of mode exact: every triangle for every ray in integers of any length (GMP), by Moeller and Trumbore's
// algebra and a division digit by digit. It shares neither code nor formulas with traversal/exact_triangle.cc.
// Immutable values.
#pragma once

#include <span>

#include "storage/base/vec3.h"
#include "traversal/query.h"

namespace raymill::tests {

/// The hit of least t in [tnear, tfar], then of least geometry id, then of least primitive id; t rounded to the nearest
/// float32, u and v to about float64. No normal. The ray must be valid.
Hit rational_closest(std::span<const storage::Triangle> triangles, const Ray& ray);

/// Whether a hit of mode exact is the oracle's: t and ids equal, u and v near.
bool agrees(const Hit& hit, const Hit& oracle);

}  // namespace raymill::tests
