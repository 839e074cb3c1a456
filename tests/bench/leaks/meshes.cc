#include "tests/bench/leaks/meshes.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace raymill::bench {
namespace {

std::string left_out(std::size_t kept, std::size_t all, const std::string& of) {
  return std::to_string(kept) + " of " + std::to_string(all) + " triangles " + of;
}

}  // namespace

Status MeshSink::add(std::span<const storage::Triangle> triangles) {
  for (const storage::Triangle& triangle : triangles) {
    mesh.push_back(triangle.v);
  }
  return {};
}

NamedMesh far_sphere() {
  const Mesh mesh = tests::sphere({148376, 1234, -223423}, 2, 200, 200);
  NamedMesh result{.name = "sphere_far", .mesh = without_flat_triangles(mesh), .note = {}};
  result.note = left_out(result.mesh.size(), mesh.size(), "have an area");
  return result;
}

NamedMesh rough_sphere() {
  tests::Random random(1);
  return {.name = "rough_sphere", .mesh = tests::rough_sphere(random, 1, 6, 80, 120), .note = {}};
}

NamedMesh box_soup(std::size_t count) {
  tests::Random random(1);
  return {.name = "box_soup", .mesh = tests::boxes(random, count), .note = {}};
}

Result<NamedMesh> closed_parts_of(const std::string& name, const std::string& scene_path) {
  storage::Ledger ledger(std::numeric_limits<std::uint64_t>::max());
  storage::ImportReport report;
  MeshSink sink;
  RAYMILL_RETURN_IF_ERROR(storage::import_scene(scene_path, {}, ledger, sink, report));
  NamedMesh result{.name = name, .mesh = closed_parts(sink.mesh), .note = {}};
  if (result.mesh.empty()) {
    return {ErrorCode::invalid_argument, scene_path + ": no part of it is closed"};
  }
  result.note = left_out(result.mesh.size(), sink.mesh.size(), "of the scene");
  return result;
}

NamedMesh on_integer_grid(const NamedMesh& mesh, unsigned bits) {
  storage::Aabb box;
  for (const Corners& corners : mesh.mesh) {
    for (const Vec3f& p : corners) {
      box.grow(p);
    }
  }
  double extent = 0;
  for (int axis = 0; axis < 3; ++axis) {
    extent = std::max(extent, double(box.upper[axis]) - box.lower[axis]);
  }
  const double scale = std::ldexp(1.0, static_cast<int>(bits)) / extent;
  NamedMesh result{.name = mesh.name + "_grid", .mesh = {}, .origin_step = 0.5F, .note = {}};
  for (Corners corners : mesh.mesh) {
    for (Vec3f& p : corners) {
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = static_cast<float>(std::nearbyint((double(p[axis]) - box.lower[axis]) * scale));
      }
    }
    result.mesh.push_back(corners);
  }
  result.mesh = without_flat_triangles(result.mesh);
  result.note = left_out(result.mesh.size(), mesh.mesh.size(), "have an area on " + std::to_string(bits) + " bits");
  return result;
}

}  // namespace raymill::bench
