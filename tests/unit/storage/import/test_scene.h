// TestScene: a glTF document put together piece by piece, whole or broken on purpose. Thread-confined.
#pragma once

#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "storage/import/scene_import.h"

namespace raymill::storage {

/// glTF component types.
constexpr int kByte = 5120, kUnsignedByte = 5121, kShort = 5122, kUnsignedShort = 5123, kUnsignedInt = 5125,
              kFloat = 5126;

class TestScene {
 public:
  TestScene();

  /// Appends `values` to the one buffer and declares a view of them; gives the view's index.
  template <typename T>
  int view(const std::vector<T>& values, int stride_bytes = 0) {
    return view_of(std::as_bytes(std::span(values)), stride_bytes);
  }
  int view_of(std::span<const std::byte> bytes, int stride_bytes = 0);

  int accessor(int view, int component_type, const char* type, std::uint64_t count);
  int positions(const std::vector<float>& xyz);
  template <typename T>
  int indices(const std::vector<T>& values) {
    const int type = sizeof(T) == 1 ? kUnsignedByte : sizeof(T) == 2 ? kUnsignedShort : kUnsignedInt;
    return accessor(view(values), type, "SCALAR", values.size());
  }
  /// A primitive in a mesh of its own, shown by a node of its own in scene 0; gives the node's index.
  int show(int positions, int indices = -1, int mode = 4);

  /// The document with its buffer as a data: URI, as a GLB, or as it stands.
  [[nodiscard]] std::string text() const;
  [[nodiscard]] std::string glb() const;

  nlohmann::json root;
  std::vector<std::byte> buffer;
};

/// What an import gave.
struct Imported {
  Status status;
  ImportReport report;
  std::vector<Triangle> triangles;
  std::size_t largest_piece = 0;
};

Imported import_bytes(const std::string& bytes, const ImportOptions& options = {},
                      std::uint64_t budget_bytes = gibibytes(1), const std::string& name = "test.gltf");
/// The same for a file of another name, and so perhaps of another format.
inline Imported import_named(const std::string& name, const std::string& bytes,
                             std::uint64_t budget_bytes = gibibytes(1)) {
  return import_bytes(bytes, {}, budget_bytes, name);
}
Imported import_path(const std::string& path, const ImportOptions& options = {},
                     std::uint64_t budget_bytes = gibibytes(1));

/// The corners of a triangle as nine numbers.
std::vector<float> corners(const Triangle& triangle);

/// `count` vertices (i, i*i, 1): no three lie in a row.
std::vector<float> vertices(int count);
/// Which vertices of vertices() the triangle has.
std::vector<int> vertex_numbers(const Triangle& triangle);

}  // namespace raymill::storage
