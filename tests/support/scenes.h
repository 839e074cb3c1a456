// Scenes made of plain triangles, and how they become a scene file. Immutable values.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "storage/base/vec3.h"
#include "tests/support/random.h"

namespace raymill::tests {

using storage::Triangle;
using storage::Vec3f;

using Corners = std::array<Vec3f, 3>;
/// One geometry id; a triangle's place is its primitive id.
using Mesh = std::vector<Corners>;
using Scene = std::vector<Mesh>;

/// Triangles of the scene with the ids that an import gives them.
std::vector<Triangle> triangles_of(const Scene& scene);
/// A .glb whose import gives exactly these corners.
std::string glb(const Scene& scene);

/// Small triangles anywhere in [-1, 1]^3.
Mesh soup(Random& random, std::size_t count, float size = 0.2F);
/// cells x cells quads in the plane z = f(x, y) over [0, 1]^2, two triangles each; bumpy where `height` is not zero.
Mesh grid(unsigned cells, float height = 0);
/// Closed: every edge belongs to two triangles.
Mesh sphere(const Vec3f& center, float radius, unsigned rings, unsigned segments);
/// As above with a radius of [low, high) for each vertex.
Mesh rough_sphere(Random& random, float low, float high, unsigned rings, unsigned segments);
/// Long and thin: a thousand times as long as wide.
Mesh needles(Random& random, std::size_t count);
/// Each triangle encloses the next: the tree of such a scene is a chain.
Mesh nested_shells(std::size_t count);
/// The same triangle, again and again.
Mesh coincident(std::size_t count);
/// Centroids on one line.
Mesh collinear(std::size_t count);
/// Closed axis-aligned boxes of 12 triangles each.
Mesh boxes(Random& random, std::size_t count);

Mesh moved(const Mesh& mesh, const Vec3f& offset, float scale = 1);
/// Vertices of a mesh, each once.
std::vector<Vec3f> vertices_of(const Mesh& mesh);

}  // namespace raymill::tests
