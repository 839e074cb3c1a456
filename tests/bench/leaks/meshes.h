// The closed meshes that rays must not leave.
#pragma once

#include <string>

#include "storage/base/status.h"
#include "storage/import/scene_import.h"
#include "tests/bench/leaks/closed_mesh.h"

namespace raymill::bench {

/// Keeps the corners of what comes.
class MeshSink final : public storage::TriangleSink {
 public:
  Status add(std::span<const storage::Triangle> triangles) override;
  Mesh mesh;
};

struct NamedMesh {
  std::string name;
  Mesh mesh;
  float origin_step = 0;  ///< coordinates of rays' origins are multiples of it; 0: any
  std::string note;       ///< what was left out of the scene
};

/// Radius 2, 200 x 200, centre (148376, 1234, -223423): a float32 there is 1/64 to 1/128 wide.
NamedMesh far_sphere();
/// A radius of 1 to 6 for each of its vertices, 80 x 120.
NamedMesh rough_sphere();
/// `count` closed boxes of 12 triangles that lie about at random, each in others' way.
NamedMesh box_soup(std::size_t count);
/// The closed parts of a scene file. Errors: those of the import; invalid_argument where no part is closed.
Result<NamedMesh> closed_parts_of(const std::string& name, const std::string& scene_path);
/// A mesh moved to whole coordinates of `bits` bits. Origins are halves, so
/// that a ray's dir to a vertex is without rounding.
NamedMesh on_integer_grid(const NamedMesh& mesh, unsigned bits);

}  // namespace raymill::bench
