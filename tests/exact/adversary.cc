#include "tests/exact/adversary.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/support/trees.h"

namespace raymill::tests {
namespace {

constexpr float kAdversaryInf = std::numeric_limits<float>::infinity();
constexpr float kPositionMost = 0x1p120F;

Vec3f along(const Vec3f& from, const Vec3f& a, const Vec3f& b, float s) {
  return {from.x + (b.x - a.x) * s, from.y + (b.y - a.y) * s, from.z + (b.z - a.z) * s};
}

float any_float(Random& random, int low_exponent, int high_exponent) {
  const int exponent = low_exponent + int(random.below(std::uint32_t(high_exponent - low_exponent + 1)));
  const float magnitude = std::ldexp(1 + random.uniform(0, 1), exponent);
  const std::uint32_t kind = random.below(8);
  return kind == 0 ? 0.0F : kind % 2 == 0 ? magnitude : -magnitude;
}
Vec3f any_point(Random& random, int low_exponent, int high_exponent) {
  const float x = any_float(random, low_exponent, high_exponent), y = any_float(random, low_exponent, high_exponent);
  return {x, y, any_float(random, low_exponent, high_exponent)};
}

// By up to `most` roundings.
float nudged(Random& random, float x, std::uint32_t most) {
  const float end = random.below(2) == 0 ? -kPositionMost : kPositionMost;
  for (std::uint32_t steps = random.below(most + 1); steps > 0; --steps) {
    x = std::nextafter(x, end);
  }
  return x;
}

Mesh small_mesh(Random& random) {
  switch (random.below(4)) {
    case 0:
      return grid(4, random.below(2) == 0 ? 0.0F : 0.4F);
    case 1:
      return sphere({}, 1, 4, 6);
    case 2:
      return boxes(random, 2);
    default:
      return soup(random, 24, 1);
  }
}

Mesh sliver_mesh(Random& random) {
  Mesh mesh;
  while (mesh.size() < 24) {
    const Vec3f a = random.in_box(-1, 1), b = random.in_box(-1, 1);
    Vec3f c = along(a, a, b, random.uniform(-0.5F, 1.5F));
    const float width = random.below(4) == 0 ? 0 : std::ldexp(1.0F, -10 - int(random.below(14)));
    for (int axis = 0; axis < 3; ++axis) {
      c[axis] = nudged(random, c[axis] + random.uniform(-width, width), 2);
    }
    mesh.push_back({a, b, c});
    if (random.below(2) == 0) {
      mesh.push_back({b, a, random.in_box(-1, 1)});  // its neighbour over the long edge
    }
  }
  return mesh;
}

Mesh thin_box(Random& random) {
  const float size = std::ldexp(random.uniform(1, 2), 13 + int(random.below(11)));
  const auto thin = int(random.below(3));
  const float place = random.below(3) == 0 ? 0.0F : random.uniform(-size, size);
  Mesh mesh = moved(boxes(random, 1), {}, size);
  Vec3f low = mesh[0][0];
  for (const Vec3f& p : vertices_of(mesh)) {
    low = min(low, p);
  }
  const float far_face = nudged(random, nudged(random, place, 4), 4);
  for (Corners& corners : mesh) {
    for (Vec3f& p : corners) {
      p[thin] = p[thin] == low[thin] ? place : far_face;
    }
  }
  return mesh;
}

Mesh copies(Random& random) {
  const Mesh base = soup(random, 4, 1);
  Mesh mesh;
  for (int copy = 0; copy < 6; ++copy) {
    for (Corners corners : base) {
      std::rotate(corners.begin(), corners.begin() + random.below(3), corners.end());
      for (Vec3f& p : corners) {
        for (int axis = 0; axis < 3 && copy % 2 == 1; ++axis) {
          p[axis] = nudged(random, p[axis], 1);
        }
      }
      mesh.push_back(corners);
    }
  }
  return mesh;
}

Mesh mixed_mesh(Random& random) {
  Mesh mesh;
  const int low = random.below(2) == 0 ? -149 : -20, high = random.below(2) == 0 ? 119 : 20;
  while (mesh.size() < 16) {
    const Vec3f a = any_point(random, low, high), b = any_point(random, low, high);
    mesh.push_back({a, b, any_point(random, low, high)});
  }
  return mesh;
}

// A point of the triangle: a corner, on an edge, inside; or of its plane alone.
Vec3f target_of(Random& random, const Corners& c) {
  const std::uint32_t first = random.below(3);
  const Vec3f &a = c[first], &b = c[(first + 1) % 3];
  switch (random.below(6)) {
    case 0:
    case 1:
      return a;
    case 2:
      return {0.5F * a.x + 0.5F * b.x, 0.5F * a.y + 0.5F * b.y, 0.5F * a.z + 0.5F * b.z};
    case 3:
      return along(a, a, b, random.uniform(0, 1));
    case 4:
      return along(along(a, a, b, random.uniform(0, 0.7F)), a, c[(first + 2) % 3], random.uniform(0, 0.3F));
    default:
      return along(along(a, a, b, random.uniform(-2, 2)), a, c[(first + 2) % 3], random.uniform(-2, 2));
  }
}

const Corners& any_triangle(Random& random, const Scene& scene) {
  const Mesh& mesh = scene[random.below(static_cast<std::uint32_t>(scene.size()))];
  return mesh[random.below(static_cast<std::uint32_t>(mesh.size()))];
}

float largest(const Corners& c) {
  float most = 0;
  for (const Vec3f& p : c) {
    most = std::max({most, std::fabs(p.x), std::fabs(p.y), std::fabs(p.z)});
  }
  return most;
}

float lowest_bit(float x) {
  int exponent = 0;
  const auto digits = static_cast<std::int32_t>(std::ldexp(std::frexp(x, &exponent), 24));
  return std::ldexp(float(digits & -digits), exponent - 24);
}

// Along an axis from 2^24 lowest bits away: t has 25 bits, a tie between two floats, where the target is met exactly.
Ray line_to_a_tie(Random& random, const Vec3f& target) {
  const auto axis = int(random.below(3));
  Vec3f org = target, dir;
  const float digits = float((1U << 23) + random.below(1U << 23)), step = 2 * lowest_bit(target[axis]);
  org[axis] = random.below(2) == 0 ? digits * step : -digits * step;
  dir[axis] = org[axis] < 0 ? 1.0F : -1.0F;
  return {{org.x, org.y, org.z}, 0, {dir.x, dir.y, dir.z}, kAdversaryInf};
}

// Origin and direction; not yet known to be finite.
Ray draw_line(Random& random, const Scene& scene) {
  const Corners& c = any_triangle(random, scene);
  const Vec3f target = target_of(random, c);
  Vec3f org, dir;
  switch (random.below(7)) {
    case 6:
      return line_to_a_tie(random, target);
    case 0: {  // few digits: where the target has few too, it is met exactly
      for (int axis = 0; axis < 3; ++axis) {
        dir[axis] = std::ldexp(float(random.below(17)) - 8, std::ilogb(largest(c) + 0x1p-140F) - 3);
      }
      const float back = std::ldexp(1.0F, int(random.below(5)) - 2);
      return {{target.x - dir.x * back, target.y - dir.y * back, target.z - dir.z * back},
              0,
              {dir.x, dir.y, dir.z},
              kAdversaryInf};
    }
    case 1:  // from a point of some triangle, maybe this one
      org = target_of(random, random.below(2) == 0 ? c : any_triangle(random, scene));
      break;
    case 2:  // from a corner, along an edge's length
      org = along(c[random.below(3)], c[0], c[1 + random.below(2)], random.uniform(-3, 3));
      break;
    case 3: {  // along an axis
      const auto axis = int(random.below(3));
      org = target;
      org[axis] += (largest(c) + 0x1p-140F) * random.uniform(-2, 2);
      break;
    }
    default: {
      const Corners& other = any_triangle(random, scene);
      org = along(other[random.below(3)], c[0], other[random.below(3)], random.uniform(-2, 2));
      break;
    }
  }
  return {{org.x, org.y, org.z}, 0, {target.x - org.x, target.y - org.y, target.z - org.z}, kAdversaryInf};
}

bool usable(const Ray& ray) {
  bool finite = true;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    finite = finite && std::isfinite(ray.org[axis]) && std::isfinite(ray.dir[axis]);
  }
  return finite && ray.dir != std::array<float, 3>{} && ray.tnear <= ray.tfar;
}

}  // namespace

Scene adversarial_scene(Random& random, Adversary adversary) {
  switch (adversary) {
    case Adversary::vertices:
      return snapped({small_mesh(random)}, -int(random.below(8)) - 2);
    case Adversary::planes:
      return snapped({boxes(random, 2), grid(2)}, -5);
    case Adversary::slivers:
      return {sliver_mesh(random)};
    case Adversary::thin_boxes:
      return {thin_box(random), thin_box(random)};
    case Adversary::denormal:
      return {moved(small_mesh(random), {}, std::ldexp(1.0F, -126 - int(random.below(20))))};
    case Adversary::far:
      return {moved(small_mesh(random), any_point(random, 10, 23))};
    case Adversary::huge:
      return {moved(small_mesh(random), {}, std::ldexp(1.0F, 60 + int(random.below(58))))};
    case Adversary::coincident:
      return {copies(random), copies(random)};
    case Adversary::mixed:
      break;
  }
  return {mixed_mesh(random)};
}

Ray adversarial_ray(Random& random, const Scene& scene, Adversary adversary) {
  while (true) {
    Ray ray = draw_line(random, scene);
    if (adversary == Adversary::mixed && random.below(2) == 0) {
      const Vec3f org = any_point(random, -149, 127);
      ray.org = {org.x, org.y, org.z};
    }
    if (random.below(4) == 0) {
      const int exponent = int(random.below(201)) - 100;
      for (float& component : ray.dir) {
        component = std::ldexp(component, exponent);
      }
    }
    if (random.below(16) == 0) {
      ray.dir[random.below(3)] = random.below(2) == 0 ? 0.0F : -0.0F;
    }
    if (random.below(4) == 0) {
      ray.tnear = random.below(2) == 0 ? -kAdversaryInf : random.uniform(-2, 1);
      ray.tfar = random.below(2) == 0 ? kAdversaryInf : random.uniform(0, 2);
    }
    if (usable(ray)) {
      return ray;
    }
  }
}

Ray at_the_end(Random& random, const Ray& ray, float t) {
  Ray cut = ray;
  const float end = random.below(3) == 0 ? t : std::nextafter(t, random.below(2) == 0 ? -kAdversaryInf : kAdversaryInf);
  (random.below(2) == 0 ? cut.tnear : cut.tfar) = end;
  if (random.below(8) == 0) {
    cut.tnear = cut.tfar = t;
  }
  return usable(cut) ? cut : ray;
}

}  // namespace raymill::tests
