#include "tests/support/masks.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "storage/import/mask_footprint.h"
#include "storage/import/triangle_filter.h"
#include "storage/io/store_builder.h"

namespace raymill::tests {

using namespace storage;

AlphaMap random_map(Random& random, std::uint32_t width, std::uint32_t height, std::uint32_t bits) {
  AlphaMap map;
  map.info.width = width;
  map.info.height = height;
  map.info.bits = static_cast<std::uint8_t>(bits);
  map.info.wrap_s = static_cast<Wrap>(random.below(3));
  map.info.wrap_t = static_cast<Wrap>(random.below(3));
  map.info.factor = bits == 1 ? 1 : double(random.uniform(0.7F, 1));
  map.info.cutoff = double(random.uniform(0.3F, 0.6F));
  map.row_bytes = AlphaMap::bytes_of_row(width, bits);
  map.texels.resize(map.row_bytes * height);
  const float a = random.uniform(2, 9), b = random.uniform(2, 9), c = random.uniform(0, 6);
  for (std::uint32_t y = 0; y < height; ++y) {
    for (std::uint32_t x = 0; x < width; ++x) {
      const float wave =
          0.5F + 0.5F * std::sin(a * float(x) / float(width) + c) * std::cos(b * float(y) / float(height));
      std::byte* row = map.texels.data() + y * map.row_bytes;
      const auto value = static_cast<std::uint32_t>(wave * (bits == 16 ? 65535 : 255));
      if (bits == 1) {
        row[x / 8] |= static_cast<std::byte>(wave > 0.5F ? 1U << (x % 8) : 0U);
      } else if (bits == 8) {
        row[x] = static_cast<std::byte>(value);
      } else {
        row[2 * std::size_t{x}] = static_cast<std::byte>(value & 255);
        row[2 * std::size_t{x} + 1] = static_cast<std::byte>(value >> 8);
      }
    }
  }
  return map;
}

MaskedScene random_masked_scene(Random& random, std::size_t triangles) {
  MaskedScene scene;
  for (const std::uint32_t bits : {1U, 1U, 8U, 16U}) {
    scene.maps.push_back(random_map(random, 1 + random.below(150), 1 + random.below(150), bits));
  }
  for (unsigned g = 0; g < 8; ++g) {
    MaskedScene::Geometry& geometry = scene.geometries.emplace_back();
    geometry.mesh = soup(random, triangles / 8, 1.2F);
    geometry.sides = static_cast<Sides>(g % 4 == 3 ? 1 + g / 4 : 0);
    for (std::size_t i = 0; g > 1 && i < geometry.mesh.size(); ++i) {
      FaceMask& face = geometry.faces.emplace_back();
      const float reach = pick(random, {0.02F, 0.3F, 1.0F, 5.0F});
      const std::array<float, 2> at{random.uniform(-2, 2), random.uniform(-2, 2)};
      for (auto& corner : face.corners) {
        corner = {at[0] + random.uniform(-reach, reach), at[1] + random.uniform(-reach, reach)};
      }
      face.mask = g % 4;
      if (scene.maps[face.mask].info.bits != 1 && random.below(2) == 0) {
        face.alphas = {random.uniform(0.3F, 1), random.uniform(0.3F, 1), random.uniform(0.3F, 1)};
      }
    }
  }
  return scene;
}

namespace {

Status add_geometry(const MaskedScene& scene, std::size_t number, StoreBuilder& builder, TriangleWriter& writer) {
  const MaskedScene::Geometry& geometry = scene.geometries[number];
  ImportReport& report = builder.import_report();
  report.add_geometry();
  writer.begin_geometry();
  std::vector<FaceMask> faces = geometry.faces;
  for (FaceMask& face : faces) {
    judge_face(scene.maps[face.mask], face.mask, face);
  }
  GeometryMask masks{GeometryMask::kNoFaces, geometry.sides};
  if (!faces.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(masks.first_face, builder.add_faces(faces));
    writer.set_faces({&builder, masks.first_face, faces.size(), false});
  }
  builder.set_masks(static_cast<std::uint32_t>(number), masks);
  for (const Corners& corners : geometry.mesh) {
    RAYMILL_RETURN_IF_ERROR(writer.add(corners));
  }
  return writer.flush();
}

}  // namespace

std::string build_masked(const TempFolder& folder, const std::string& name, const MaskedScene& scene,
                         BuildConfig config) {
  config.output = folder / name;
  const auto run = [&]() -> Status {
    RAYMILL_ASSIGN_OR_RETURN(const auto builder, StoreBuilder::create(config));
    for (const AlphaMap& map : scene.maps) {
      RAYMILL_RETURN_IF_ERROR(builder->add_mask(map).status());
    }
    TriangleWriter writer(*builder, builder->import_report());
    for (std::size_t i = 0; i < scene.geometries.size(); ++i) {
      RAYMILL_RETURN_IF_ERROR(add_geometry(scene, i, *builder, writer));
    }
    return builder->finish().status();
  };
  const Status status = run();
  EXPECT_TRUE(status.ok()) << status.message();
  return config.output;
}

bool counts_at(const MaskedScene& scene, const FaceMask& face, double u, double v) {
  const AlphaMap& map = scene.maps[face.mask];
  const MaskInfo& info = map.info;
  const TexelPoint at = texel_point(face.corners, u, v, info.width, info.height);
  const std::uint32_t value = map.value(wrap_texel(std::int64_t(std::floor(at.x)), info.width, info.wrap_s),
                                        wrap_texel(std::int64_t(std::floor(at.y)), info.height, info.wrap_t));
  const double alpha = between(face.alphas[0], face.alphas[1], face.alphas[2], u, v);
  return info.bits == 1 ? value == 1 : counts(value, info.bits == 8 ? 255 : 65535, info.factor, alpha, info.cutoff);
}

namespace {

using Vector = std::array<double, 3>;
Vector cross(const Vector& a, const Vector& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

struct Meeting {
  double t, u, v;
  bool counterclockwise;
};

// Moeller, Trumbore 1997, in float64.
std::optional<Meeting> meet(const Ray& ray, const Corners& corners) {
  Vector e1, e2, s, dir;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const int a = static_cast<int>(axis);
    e1[axis] = double(corners[1][a]) - corners[0][a];
    e2[axis] = double(corners[2][a]) - corners[0][a];
    s[axis] = double(ray.org[axis]) - corners[0][a];
    dir[axis] = ray.dir[axis];
  }
  const Vector p = cross(dir, e2), q = cross(s, e1);
  const double det = dot(e1, p);
  const Meeting meeting{dot(e2, q) / det, dot(s, p) / det, dot(dir, q) / det, det > 0};
  const bool inside = meeting.u >= 0 && meeting.v >= 0 && meeting.u + meeting.v <= 1;
  return det != 0 && inside && meeting.t >= ray.tnear && meeting.t <= ray.tfar ? std::optional(meeting) : std::nullopt;
}

}  // namespace

Hit nearest(const MaskedScene& scene, const Ray& ray) {
  Hit best;
  double t = std::numeric_limits<double>::infinity();
  for (std::uint32_t g = 0; g < scene.geometries.size(); ++g) {
    const MaskedScene::Geometry& geometry = scene.geometries[g];
    for (std::uint32_t i = 0; i < geometry.mesh.size(); ++i) {
      const auto meeting = meet(ray, geometry.mesh[i]);
      if (!meeting || meeting->t >= t ||
          (geometry.sides != Sides::both && meeting->counterclockwise != (geometry.sides == Sides::counterclockwise)) ||
          (!geometry.faces.empty() && !counts_at(scene, geometry.faces[i], meeting->u, meeting->v))) {
        continue;
      }
      t = meeting->t;
      best.t = static_cast<float>(t);
      best.geometry_id = g;
      best.primitive_id = i;
    }
  }
  return best;
}

}  // namespace raymill::tests
