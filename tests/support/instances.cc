#include "tests/support/instances.h"

#include <cmath>
#include <limits>

#include "tests/support/rays.h"

namespace raymill::tests {

using storage::Aabb;
using storage::Placement;

namespace {

storage::Vec3f apply(const PlacedScene::Matrix& m, const storage::Vec3f& p) {
  std::array<float, 3> out{};
  for (std::size_t row = 0; row < 3; ++row) {
    out[row] = static_cast<float>(m[row] * p.x + m[4 + row] * p.y + m[8 + row] * p.z + m[12 + row]);
  }
  return {out[0], out[1], out[2]};
}

Placement placement(const PlacedScene::Matrix& m) {
  return {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10], m[12], m[13], m[14]};
}

// By Cramer's rule in float64, rounded once: what the kernel computes, written for one vector at a time.
std::array<float, 3> into_object(const Placement& m, std::array<double, 3> v, bool point) {
  const auto column = [&m](std::size_t k) { return std::array<double, 3>{m[k * 3], m[k * 3 + 1], m[k * 3 + 2]}; };
  const auto cross = [](const std::array<double, 3>& a, const std::array<double, 3>& b) {
    return std::array<double, 3>{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  };
  const double det = storage::determinant(m);
  std::array<float, 3> out{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto row = cross(column((axis + 1) % 3), column((axis + 2) % 3));
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      sum += row[k] * (point ? v[k] - m[9 + k] : v[k]);
    }
    out[axis] = static_cast<float>(sum / det);
  }
  return out;
}

Aabb bounds_of(const Scene& scene) {
  Aabb box;
  for (const Triangle& t : triangles_of(scene)) {
    box.grow(storage::bounds(t));
  }
  return box;
}

// The interval of slab.h. False: the ray passes the box.
bool enters(const Ray& ray, const Aabb& box, float& entry) {
  float exit = std::numeric_limits<float>::infinity();
  entry = -exit;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int a = static_cast<int>(axis);
    const bool negative = std::signbit(ray.dir[axis]);
    const float rdir = 1.0F / ray.dir[axis];
    const float near = ((negative ? box.upper : box.lower)[a] - ray.org[axis]) * rdir;
    const float far = ((negative ? box.lower : box.upper)[a] - ray.org[axis]) * rdir;
    entry = near > entry ? near : entry;
    exit = far < exit ? far : exit;
  }
  exit = exit + std::fabs(exit) * 0x1p-21F;
  return entry <= exit && ray.tnear <= exit && entry <= ray.tfar;
}

bool before(const Hit& a, const Hit& b) {
  return a.t != b.t                       ? a.t < b.t
         : a.geometry_id != b.geometry_id ? a.geometry_id < b.geometry_id
                                          : a.primitive_id < b.primitive_id;
}

}  // namespace

PlacedScene::Matrix random_matrix(Random& random, float reach) {
  PlacedScene::Matrix m{};
  do {
    for (std::size_t column = 0; column < 3; ++column) {
      const auto d = random.direction();
      const double length = random.uniform(0.3F, 2);
      m[column * 4] = d.x * length;
      m[column * 4 + 1] = d.y * length;
      m[column * 4 + 2] = d.z * length;
    }
  } while (std::abs(storage::determinant(placement(m))) < 0.05);
  const auto offset = random.in_box(-reach, reach);
  m[12] = offset.x;
  m[13] = offset.y;
  m[14] = offset.z;
  m[15] = 1;
  return m;
}

PlacedScene random_placed_scene(Random& random, std::size_t places) {
  PlacedScene scene;
  scene.world = {grid(12, 0.2F), soup(random, 300)};
  scene.objects = {{sphere({0.5F, 0, 0}, 0.7F, 9, 14), boxes(random, 6)}, {soup(random, 700, 0.3F)}, {grid(4)}};
  for (std::size_t i = 0; i < places; ++i) {
    scene.places.push_back({random.below(static_cast<std::uint32_t>(scene.objects.size())), random_matrix(random, 6)});
  }
  scene.places.push_back(scene.places.front());  // all the same, once more
  return scene;
}

Scene flattened(const PlacedScene& scene) {
  Scene flat = scene.world;
  for (const PlacedScene::Place& place : scene.places) {
    for (const Mesh& mesh : scene.objects[place.object]) {
      Mesh& moved = flat.emplace_back();
      for (const Corners& c : mesh) {
        moved.push_back({apply(place.world_from_object, c[0]), apply(place.world_from_object, c[1]),
                         apply(place.world_from_object, c[2])});
      }
    }
  }
  return flat;
}

std::string build_placed(const TempFolder& folder, const std::string& name, const PlacedScene& scene,
                         BuildConfig config) {
  config.output = folder / name;
  auto writer = StoreWriter::create(config);
  EXPECT_TRUE(writer) << writer.status().message();
  const auto view = [](const Mesh& mesh) {
    return MeshView{.name = "mesh", .positions = {&mesh[0][0].x, mesh.size() * 9}};
  };
  for (const Mesh& mesh : scene.world) {
    EXPECT_TRUE(writer->add(view(mesh)).ok());
  }
  for (const Scene& object : scene.objects) {
    std::vector<MeshView> meshes;
    for (const Mesh& mesh : object) {
      meshes.push_back(view(mesh));
    }
    const auto added = writer->add_object(meshes);
    EXPECT_TRUE(added) << added.status().message();
  }
  for (const PlacedScene::Place& place : scene.places) {
    const Status placed = writer->place(place.object, place.world_from_object);
    EXPECT_TRUE(placed.ok()) << placed.message();
  }
  const auto report = writer->finish();
  EXPECT_TRUE(report) << report.status().message();
  return config.output;
}

std::vector<Hit> expected_hits(const TempFolder& folder, const PlacedScene& scene, std::span<const Ray> rays,
                               Mode mode) {
  TraceSetup setup;
  setup.trace.mode = mode;
  std::vector<Hit> best = trace(build_store(folder, "expected-world.mill", scene.world), rays, setup).hits;
  std::vector<std::string> stores;
  for (const Scene& object : scene.objects) {
    stores.push_back(build_store(folder, "expected-" + std::to_string(stores.size()) + ".mill", object));
  }
  auto base = static_cast<std::uint32_t>(scene.world.size());
  for (std::uint32_t i = 0; i < scene.places.size(); ++i) {
    const PlacedScene::Place& place = scene.places[i];
    const Scene& object = scene.objects[place.object];
    const Placement m = placement(place.world_from_object);
    const Aabb box = storage::placed_box(m, bounds_of(object));
    std::vector<Ray> inside(rays.begin(), rays.end());
    for (Ray& ray : inside) {
      ray.org = into_object(m, {ray.org[0], ray.org[1], ray.org[2]}, true);
      ray.dir = into_object(m, {ray.dir[0], ray.dir[1], ray.dir[2]}, false);
    }
    const std::vector<Hit> hits = trace(stores[place.object], inside, setup).hits;
    for (std::size_t k = 0; k < rays.size(); ++k) {
      float entry = 0;
      Hit hit = hits[k];
      if (hit.primitive_id == kNoId || !enters(rays[k], box, entry)) {
        continue;
      }
      hit.t = std::max(hit.t, entry);
      hit.geometry_id += base;
      hit.instance_id = i;
      if (hit.t <= rays[k].tfar && before(hit, best[k])) {
        best[k] = hit;
      }
    }
    base += static_cast<std::uint32_t>(object.size());
  }
  return best;
}

}  // namespace raymill::tests
