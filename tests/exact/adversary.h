// Small scenes, and rays that are chosen to sit where a triangle test must decide: through vertices, along edges, in
// planes, past slivers, into boxes that are thinner than a rounding, at the ends of float32. Immutable values.
#pragma once

#include <array>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/scenes.h"
#include "traversal/query.h"

namespace raymill::tests {

enum class Adversary : std::uint8_t {
  vertices,    ///< meshes on a coarse grid of binary fractions, so that rays meet vertices and edges exactly
  planes,      ///< boxes and tilted planes, rays within them
  slivers,     ///< triangles a thousand to ten million times as long as wide, down to a rounding
  thin_boxes,  ///< boxes of 10^4 to 10^7 units that are a few roundings thick
  denormal,    ///< everything below 1e-38
  far,         ///< unit-sized meshes up to 10^7 units out
  huge,        ///< up to 2^119
  coincident,  ///< copies of one another, some moved by a rounding
  mixed,       ///< any exponent for each coordinate
};
constexpr std::array<const char*, 9> kAdversaries = {"vertices", "planes", "slivers",    "thin_boxes", "denormal",
                                                     "far",      "huge",   "coincident", "mixed"};

Scene adversarial_scene(Random& random, Adversary adversary);
/// A valid ray.
Ray adversarial_ray(Random& random, const Scene& scene, Adversary adversary);
/// The ray with an interval that ends at, before or after a hit's t.
Ray at_the_end(Random& random, const Ray& ray, float t);

}  // namespace raymill::tests
