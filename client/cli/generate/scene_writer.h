// SceneWriter: a glTF scene of any size, written as it is made.
//
// Triangles gather in a patch; a patch that is large enough becomes a mesh, a node and a .bin file of its own, so
// memory is that of one patch (about 20 MB at most) whatever the scene. For NAME.gltf the buffers are NAME-00000.bin
// and so on, beside it. Without finish() everything that was written is removed again. Thread-confined.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "client/cli/camera.h"
#include "storage/base/atomic_file.h"
#include "storage/base/status.h"

namespace raymill::client {

/// Triangles after which a patch is written.
constexpr std::uint64_t kPatchTriangles = 512 << 10;

using Point = std::array<float, 3>;

/// Where a patch stands, as EXT_mesh_gpu_instancing says it: scaled, turned by a quaternion x y z w, moved.
struct Stand {
  Point translation{};
  std::array<float, 4> rotation{0, 0, 0, 1};
  Point scale{1, 1, 1};
};

class SceneWriter {
 public:
  /// Called after each patch with the triangles written so far; returns false to stop (interrupted).
  using Observer = std::function<bool(std::uint64_t triangles)>;

  static Result<SceneWriter> create(const std::string& gltf_path, Observer observer);
  SceneWriter(SceneWriter&&) = default;
  SceneWriter& operator=(SceneWriter&&) = delete;
  ~SceneWriter();

  std::uint32_t vertex(const Point& p);
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c);
  /// A triangle with vertices of its own.
  void facet(const Point& a, const Point& b, const Point& c);
  /// Two triangles a b c, a c d.
  void quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d);

  /// Between two objects, where the vertices of the next are its own: writes the patch if it is large enough.
  Status end_object(const std::string& name);
  /// Writes what the patch holds.
  Status end_patch(const std::string& name) { return end_patch(name, {}); }
  /// The same for a mesh that stands in all these places.
  Status end_patch(const std::string& name, std::span<const Stand> stands);

  void add_camera(const std::string& name, const Camera& camera);
  /// Writes the .gltf file, last.
  Status finish();

  [[nodiscard]] std::uint64_t triangles() const { return triangles_; }  ///< patch included; where they stand
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }          ///< of the files written
  [[nodiscard]] std::size_t files() const { return patches_.size(); }   ///< .bin files written

 private:
  struct Patch {
    std::string name;
    std::string file;  ///< without its folder
    std::uint64_t vertex_count = 0;
    std::uint64_t index_count = 0;
    std::uint64_t stands = 0;  ///< 0: it stands once, where its vertices say
    Point lower{}, upper{};
  };
  struct SceneCamera {
    std::string name;
    Camera camera;
  };

  SceneWriter(storage::AtomicFile file, Observer observer) : file_(std::move(file)), observer_(std::move(observer)) {}

  storage::AtomicFile file_;
  Observer observer_;
  std::string stem_;  ///< path of the scene without ".gltf"
  std::vector<Point> positions_;
  std::vector<std::uint32_t> indices_;
  std::vector<Patch> patches_;
  std::vector<SceneCamera> cameras_;
  std::vector<std::string> written_;  ///< paths to remove unless finished
  std::uint64_t triangles_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace raymill::client
