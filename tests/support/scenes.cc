#include "tests/support/scenes.h"

#include <cmath>
#include <cstring>

#include "storage/base/position_map.h"

namespace raymill::tests {
namespace {

template <typename T>
void append(std::string& out, const T& value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::string bounds_json(const Mesh& mesh) {
  storage::Aabb box;
  for (const Corners& corners : mesh) {
    for (const Vec3f& p : corners) {
      box.grow(p);
    }
  }
  char text[256];
  std::snprintf(text, sizeof text, "\"min\":[%.9g,%.9g,%.9g],\"max\":[%.9g,%.9g,%.9g]", box.lower.x, box.lower.y,
                box.lower.z, box.upper.x, box.upper.y, box.upper.z);
  return text;
}

Vec3f on_sphere(const Vec3f& center, float radius, unsigned ring, unsigned rings, unsigned segment, unsigned segments) {
  if (ring == 0 || ring == rings) {
    return {center.x, center.y, center.z + (ring == 0 ? radius : -radius)};
  }
  const double theta = 3.14159265358979 * ring / rings, phi = 6.28318530717959 * (segment % segments) / segments;
  return {float(center.x + radius * std::sin(theta) * std::cos(phi)),
          float(center.y + radius * std::sin(theta) * std::sin(phi)), float(center.z + radius * std::cos(theta))};
}

// Joins a sphere's grid of points to triangles without leaving a degenerate one at the poles.
template <typename Point>
Mesh join_rings(unsigned rings, unsigned segments, Point&& point) {
  Mesh mesh;
  for (unsigned ring = 0; ring < rings; ++ring) {
    for (unsigned segment = 0; segment < segments; ++segment) {
      const Vec3f a = point(ring, segment), b = point(ring + 1, segment);
      const Vec3f c = point(ring + 1, segment + 1), d = point(ring, segment + 1);
      if (ring + 1 < rings) {
        mesh.push_back({a, b, c});
      }
      if (ring > 0) {
        mesh.push_back({a, c, d});
      }
    }
  }
  return mesh;
}

}  // namespace

std::vector<Triangle> triangles_of(const Scene& scene) {
  std::vector<Triangle> triangles;
  for (std::uint32_t geometry = 0; geometry < scene.size(); ++geometry) {
    for (std::uint32_t i = 0; i < scene[geometry].size(); ++i) {
      triangles.push_back({scene[geometry][i], geometry, i});
    }
  }
  return triangles;
}

std::string glb(const Scene& scene) {
  std::string bin, views, accessors, meshes, nodes, roots;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    const std::string index = std::to_string(i), comma = i == 0 ? "" : ",";
    const std::size_t begin = bin.size();
    for (const Corners& corners : scene[i]) {
      append(bin, corners);
    }
    views += comma + "{\"buffer\":0,\"byteOffset\":" + std::to_string(begin) +
             ",\"byteLength\":" + std::to_string(bin.size() - begin) + "}";
    accessors += comma + "{\"bufferView\":" + index +
                 ",\"componentType\":5126,\"type\":\"VEC3\",\"count\":" + std::to_string(scene[i].size() * 3) + "," +
                 bounds_json(scene[i]) + "}";
    meshes += comma + "{\"primitives\":[{\"attributes\":{\"POSITION\":" + index + "}}]}";
    nodes += comma + "{\"mesh\":" + index + "}";
    roots += comma + index;
  }
  std::string json = "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[" + roots +
                     "]}],\"nodes\":[" + nodes + "],\"meshes\":[" + meshes + "],\"accessors\":[" + accessors +
                     "],\"bufferViews\":[" + views + "],\"buffers\":[{\"byteLength\":" + std::to_string(bin.size()) +
                     "}]}";
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string out = "glTF";
  append(out, std::uint32_t{2});
  append(out, static_cast<std::uint32_t>(12 + 8 + json.size() + 8 + bin.size()));
  append(out, static_cast<std::uint32_t>(json.size()));
  out += "JSON" + json;
  append(out, static_cast<std::uint32_t>(bin.size()));
  return out + std::string("BIN\0", 4) + bin;
}

Mesh soup(Random& random, std::size_t count, float size) {
  Mesh mesh;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f at = random.in_box(-1, 1);
    Corners corners;
    for (Vec3f& p : corners) {
      const Vec3f d = random.in_box(-size, size);
      p = {at.x + d.x, at.y + d.y, at.z + d.z};
    }
    mesh.push_back(corners);
  }
  return mesh;
}

Mesh grid(unsigned cells, float height) {
  const auto point = [&](unsigned i, unsigned j) {
    const float x = float(i) / float(cells), y = float(j) / float(cells);
    return Vec3f{x, y, height * std::sin(12.9F * x + 4.1F * y) * std::cos(7.3F * y)};
  };
  Mesh mesh;
  for (unsigned i = 0; i < cells; ++i) {
    for (unsigned j = 0; j < cells; ++j) {
      mesh.push_back({point(i, j), point(i + 1, j), point(i + 1, j + 1)});
      mesh.push_back({point(i, j), point(i + 1, j + 1), point(i, j + 1)});
    }
  }
  return mesh;
}

Mesh sphere(const Vec3f& center, float radius, unsigned rings, unsigned segments) {
  return join_rings(rings, segments, [&](unsigned ring, unsigned segment) {
    return on_sphere(center, radius, ring, rings, segment, segments);
  });
}

Mesh rough_sphere(Random& random, float low, float high, unsigned rings, unsigned segments) {
  std::vector<float> radius((rings + 1) * segments);
  for (float& r : radius) {
    r = random.uniform(low, high);
  }
  return join_rings(rings, segments, [&](unsigned ring, unsigned segment) {
    const unsigned column = ring == 0 || ring == rings ? 0 : segment % segments;
    return on_sphere({}, radius[ring * segments + column], ring, rings, segment, segments);
  });
}

Mesh needles(Random& random, std::size_t count) {
  Mesh mesh;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f a = random.in_box(-1, 1), b = random.in_box(-1, 1), d = random.in_box(-0.001F, 0.001F);
    mesh.push_back({a, b, {b.x + d.x, b.y + d.y, b.z + d.z}});
  }
  return mesh;
}

Mesh nested_shells(std::size_t count) {
  Mesh mesh;
  for (std::size_t i = 0; i < count; ++i) {
    const float r = 1 + float(i) * 0.01F;
    mesh.push_back({Vec3f{-r, -r, -r}, {r, -r, r}, {0, r, 0}});
  }
  return mesh;
}

Mesh coincident(std::size_t count) { return Mesh(count, {Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}); }

Mesh collinear(std::size_t count) {
  Mesh mesh;
  for (std::size_t i = 0; i < count; ++i) {
    const float x = float(i);
    mesh.push_back({Vec3f{x - 0.25F, -1, -1}, {x, 2, -1}, {x + 0.25F, -1, 2}});
  }
  return mesh;
}

Mesh boxes(Random& random, std::size_t count) {
  // Corner i has its bits as coordinates; two triangles a face.
  constexpr int kFaces[12][3] = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                                 {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  Mesh mesh;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3f lower = random.in_box(-1, 1), size = random.in_box(0.01F, 0.3F);
    for (const auto& face : kFaces) {
      Corners corners;
      for (int k = 0; k < 3; ++k) {
        for (int axis = 0; axis < 3; ++axis) {
          corners[static_cast<std::size_t>(k)][axis] = lower[axis] + ((face[k] >> axis & 1) != 0 ? size[axis] : 0.0F);
        }
      }
      mesh.push_back(corners);
    }
  }
  return mesh;
}

Mesh moved(const Mesh& mesh, const Vec3f& offset, float scale) {
  Mesh result = mesh;
  for (Corners& corners : result) {
    for (Vec3f& p : corners) {
      p = {p.x * scale + offset.x, p.y * scale + offset.y, p.z * scale + offset.z};
    }
  }
  return result;
}

std::vector<Vec3f> vertices_of(const Mesh& mesh) {
  storage::PositionMap positions;
  for (const Corners& corners : mesh) {
    for (const Vec3f& p : corners) {
      positions.insert(p);
    }
  }
  return positions.positions();
}

}  // namespace raymill::tests
