// Rays for tests, and hits as comparable text. Immutable values.
#pragma once

#include <string>
#include <vector>

#include "storage/base/vec3.h"
#include "tests/support/random.h"
#include "tests/support/scenes.h"
#include "traversal/query.h"

namespace raymill::tests {

Ray ray(const storage::Vec3f& org, const storage::Vec3f& dir);
/// Not normalised: the target lies at about t = 1.
Ray ray_towards(const storage::Vec3f& org, const storage::Vec3f& target);

/// Origins in a box around `bounds`, a good part of them aimed into it; some axis-parallel, some with intervals.
std::vector<Ray> random_rays(Random& random, const storage::Aabb& bounds, std::size_t count);
/// Rays on whose interval or direction something is odd: NaN, infinities, zeros of both signs, crossed intervals.
std::vector<Ray> hostile_rays();

/// Every bit of a hit: equal text is equal bits, but for which NaN it is.
std::string text_of(const Hit& hit);
std::string text_of(const Ray& ray);
bool same_bits(const Hit& a, const Hit& b);

/// `count` random rays about the scene, two hundred at vertices of its first mesh, and the hostile ones among them.
std::vector<Ray> mixed_rays(Random& random, const Scene& scene, std::size_t count);

}  // namespace raymill::tests
