#include "tests/support/mesh_files.h"

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <map>

namespace raymill::tests {

namespace {

std::string in_words(const Vec3f& p) {
  char line[80];
  std::snprintf(line, sizeof line, "%.9g %.9g %.9g", double(p.x), double(p.y), double(p.z));
  return line;
}

// Each position once, by its bits, in the order of first use.
struct Indexed {
  std::vector<Vec3f> vertices;
  std::vector<std::uint32_t> indices;
};

Indexed indexed(const Mesh& mesh) {
  Indexed result;
  std::map<std::array<std::uint32_t, 3>, std::uint32_t> known;
  for (const Corners& corners : mesh) {
    for (const Vec3f& corner : corners) {
      std::array<std::uint32_t, 3> bits;
      std::memcpy(bits.data(), &corner, sizeof corner);
      const auto [it, fresh] = known.emplace(bits, static_cast<std::uint32_t>(result.vertices.size()));
      if (fresh) {
        result.vertices.push_back(corner);
      }
      result.indices.push_back(it->second);
    }
  }
  return result;
}

template <typename T>
void append_number(std::string& bytes, T value, bool turned) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (turned) {
    std::reverse(raw, raw + sizeof(T));
  }
  bytes.append(raw, sizeof(T));
}

}  // namespace

std::string ply(const Mesh& mesh, PlyKind kind) {
  const Indexed parts = indexed(mesh);
  const char* name = kind == PlyKind::text            ? "ascii"
                     : kind == PlyKind::little_endian ? "binary_little_endian"
                                                      : "binary_big_endian";
  std::string file = "ply\nformat " + std::string(name) + " 1.0\nelement vertex " +
                     std::to_string(parts.vertices.size()) +
                     "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                     std::to_string(mesh.size()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  const bool turned = kind == PlyKind::big_endian;
  for (const Vec3f& p : parts.vertices) {
    if (kind == PlyKind::text) {
      file += in_words(p) + "\n";
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) {
      append_number(file, p[axis], turned);
    }
  }
  for (std::size_t i = 0; i < parts.indices.size(); ++i) {
    const auto index = static_cast<std::int32_t>(parts.indices[i]);
    if (kind == PlyKind::text) {
      file += (i % 3 == 0 ? "3 " : " ") + std::to_string(index) + (i % 3 == 2 ? "\n" : "");
      continue;
    }
    if (i % 3 == 0) {
      append_number(file, std::uint8_t{3}, false);
    }
    append_number(file, index, turned);
  }
  return file;
}

std::string obj(const Scene& scene, bool negative) {
  std::string file;
  std::int64_t before = 0;
  for (std::size_t m = 0; m < scene.size(); ++m) {
    const Indexed parts = indexed(scene[m]);
    const auto count = static_cast<std::int64_t>(parts.vertices.size());
    for (const Vec3f& p : parts.vertices) {
      file += "v " + in_words(p) + "\n";
    }
    file += "g mesh" + std::to_string(m) + "\n";
    for (std::size_t i = 0; i < parts.indices.size(); ++i) {
      const std::int64_t index = parts.indices[i];
      file += (i % 3 == 0 ? "f " : " ") + std::to_string(negative ? index - count : before + index + 1) +
              (i % 3 == 2 ? "\n" : "");
    }
    before += count;
  }
  return file;
}

std::string stl_text(const Scene& scene) {
  std::string file;
  for (const Mesh& mesh : scene) {
    file += "solid\n";
    for (const Corners& corners : mesh) {
      file += "facet normal 0 0 0\nouter loop\n";
      for (const Vec3f& corner : corners) {
        file += "vertex " + in_words(corner) + "\n";
      }
      file += "endloop\nendfacet\n";
    }
    file += "endsolid\n";
  }
  return file;
}

std::string stl_binary(const Mesh& mesh) {
  std::string file = "solid, and binary all the same";
  file.resize(80, ' ');
  append_number(file, static_cast<std::uint32_t>(mesh.size()), false);
  for (const Corners& corners : mesh) {
    file.append(sizeof(Vec3f), '\0');
    file.append(reinterpret_cast<const char*>(corners.data()), sizeof corners);
    file.append(2, '\0');
  }
  return file;
}

}  // namespace raymill::tests
