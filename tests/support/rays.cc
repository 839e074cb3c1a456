#include "tests/support/rays.h"

#include <bit>
#include <cmath>
#include <cstdio>
#include <limits>

namespace raymill::tests {
namespace {

using storage::Vec3f;

bool same(float a, float b) {
  return std::bit_cast<std::uint32_t>(a) == std::bit_cast<std::uint32_t>(b) || (std::isnan(a) && std::isnan(b));
}

}  // namespace

Ray ray(const Vec3f& org, const Vec3f& dir) {
  Ray r;
  r.org = {org.x, org.y, org.z};
  r.dir = {dir.x, dir.y, dir.z};
  return r;
}

Ray ray_towards(const Vec3f& org, const Vec3f& target) {
  return ray(org, {target.x - org.x, target.y - org.y, target.z - org.z});
}

std::vector<Ray> random_rays(Random& random, const storage::Aabb& bounds, std::size_t count) {
  const auto point = [&](float margin) {
    Vec3f p;
    for (int axis = 0; axis < 3; ++axis) {
      const float extent = bounds.upper[axis] - bounds.lower[axis] + 1e-3F;
      p[axis] = random.uniform(bounds.lower[axis] - margin * extent, bounds.upper[axis] + margin * extent);
    }
    return p;
  };
  std::vector<Ray> rays;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t kind = random.below(8);
    const Vec3f org = point(kind < 4 ? 0.6F : 0.1F);
    Ray r = kind < 6 ? ray_towards(org, point(0.0F)) : ray(org, random.direction());
    if (kind == 5) {
      r.dir[random.below(3)] = random.below(2) == 0 ? 0.0F : -0.0F;
    }
    if (kind == 7) {
      const auto axis = random.below(3);
      r.dir = {0, 0, 0};
      r.dir[axis] = random.below(2) == 0 ? 1.0F : -2.0F;
    }
    if (random.below(4) == 0) {
      r.tnear = random.uniform(-0.5F, 0.5F);
      r.tfar = r.tnear + random.uniform(0, 2);
    }
    if (r.dir == std::array<float, 3>{}) {
      r.dir[0] = 1;
    }
    rays.push_back(r);
  }
  return rays;
}

std::vector<Ray> hostile_rays() {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN(), kInf = std::numeric_limits<float>::infinity();
  std::vector<Ray> rays;
  const Ray good = ray({0.25F, 0.25F, 1}, {0, 0, -1});
  for (const float value : {kNan, kInf, -kInf, 0.0F, -0.0F, 1e-45F, 3e38F, -3e38F}) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      Ray org = good, dir = good;
      org.org[axis] = value;
      dir.dir[axis] = value;
      rays.push_back(org);
      rays.push_back(dir);
    }
    Ray tnear = good, tfar = good, both = good;
    tnear.tnear = value;
    tfar.tfar = value;
    both.tnear = both.tfar = value;
    rays.insert(rays.end(), {tnear, tfar, both});
  }
  Ray crossed = good;
  crossed.tnear = 2;
  crossed.tfar = 1;
  rays.push_back(crossed);
  rays.push_back(ray({0, 0, 0}, {0, 0, 0}));
  rays.push_back(ray({0, 0, 0}, {-0.0F, 0, -0.0F}));
  return rays;
}

std::string text_of(const Hit& hit) {
  char text[256];
  std::snprintf(text, sizeof text, "t %a u %a v %a primitive %u geometry %u normal %a %a %a", double(hit.t),
                double(hit.u), double(hit.v), hit.primitive_id, hit.geometry_id, double(hit.normal[0]),
                double(hit.normal[1]), double(hit.normal[2]));
  return text;
}

std::string text_of(const Ray& ray) {
  char text[256];
  std::snprintf(text, sizeof text, "org {%a, %a, %a} dir {%a, %a, %a} [%a, %a]", double(ray.org[0]), double(ray.org[1]),
                double(ray.org[2]), double(ray.dir[0]), double(ray.dir[1]), double(ray.dir[2]), double(ray.tnear),
                double(ray.tfar));
  return text;
}

bool same_bits(const Hit& a, const Hit& b) {
  bool equal = same(a.t, b.t) && same(a.u, b.u) && same(a.v, b.v) && a.primitive_id == b.primitive_id &&
               a.geometry_id == b.geometry_id && a.instance_id == b.instance_id && a.count == b.count;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    equal = equal && same(a.normal[axis], b.normal[axis]);
  }
  return equal;
}

std::vector<Ray> mixed_rays(Random& random, const Scene& scene, std::size_t count) {
  storage::Aabb bounds;
  for (const Triangle& t : triangles_of(scene)) {
    bounds.grow(storage::bounds(t));
  }
  std::vector<Ray> rays = random_rays(random, bounds, count);
  const auto vertices = vertices_of(scene[0]);
  for (int i = 0; i < 200; ++i) {
    const auto number = random.below(static_cast<std::uint32_t>(vertices.size()));
    rays.push_back(ray_towards({0.1F, 0.2F, 0.3F}, vertices[number]));
  }
  const std::vector<Ray> hostile = hostile_rays();
  rays.insert(rays.begin() + static_cast<std::ptrdiff_t>(count / 4), hostile.begin(), hostile.end());
  return rays;
}

}  // namespace raymill::tests
