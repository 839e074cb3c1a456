#include "client/cli/generate/scene_writer.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <span>

namespace raymill::client {

namespace {

constexpr std::string_view kExtension = ".gltf";

// glTF 2.0: componentType and target.
constexpr int kUnsignedInt = 5125;
constexpr int kFloat = 5126;
constexpr int kArrayBuffer = 34962;
constexpr int kElementArrayBuffer = 34963;

std::string file_name(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

constexpr const char* kInstancing = "EXT_mesh_gpu_instancing";

// One member of all stands, one after the other.
template <typename T>
Status write_column(storage::AtomicFile& file, std::span<const Stand> stands, T Stand::*member) {
  std::vector<T> column;
  for (const Stand& stand : stands) {
    column.push_back(stand.*member);
  }
  return file.write(std::as_bytes(std::span(column)));
}

// Column-major; the third column is +z, which lies behind the camera.
nlohmann::json matrix_of(const Camera& c) {
  return {c.right[0],    c.right[1],    c.right[2],    0.0, c.up[0],     c.up[1],     c.up[2],     0.0,
          -c.forward[0], -c.forward[1], -c.forward[2], 0.0, c.origin[0], c.origin[1], c.origin[2], 1.0};
}

}  // namespace

Result<SceneWriter> SceneWriter::create(const std::string& gltf_path, Observer observer) {
  if (!gltf_path.ends_with(kExtension) || gltf_path.size() == kExtension.size()) {
    return Status(ErrorCode::invalid_argument, "the scene's name must end in .gltf, '" + gltf_path + "' does not");
  }
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile file, storage::AtomicFile::create(gltf_path));
  SceneWriter writer(std::move(file), std::move(observer));
  writer.stem_ = gltf_path.substr(0, gltf_path.size() - kExtension.size());
  writer.indices_.reserve(3 * kPatchTriangles);
  return writer;
}

SceneWriter::~SceneWriter() {
  for (const std::string& path : written_) {
    ::unlink(path.c_str());
  }
}

std::uint32_t SceneWriter::vertex(const Point& p) {
  positions_.push_back(p);
  return static_cast<std::uint32_t>(positions_.size() - 1);
}

void SceneWriter::triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  indices_.insert(indices_.end(), {a, b, c});
  ++triangles_;
}

void SceneWriter::facet(const Point& a, const Point& b, const Point& c) {
  const std::uint32_t first = vertex(a);
  vertex(b);
  vertex(c);
  triangle(first, first + 1, first + 2);
}

void SceneWriter::quad(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
  triangle(a, b, c);
  triangle(a, c, d);
}

Status SceneWriter::end_object(const std::string& name) {
  return indices_.size() >= 3 * kPatchTriangles ? end_patch(name) : Status();
}

Status SceneWriter::end_patch(const std::string& name, std::span<const Stand> stands) {
  if (indices_.empty()) {
    positions_.clear();
    return {};
  }
  char suffix[32];
  std::snprintf(suffix, sizeof suffix, "-%05zu.bin", patches_.size());
  const std::string path = stem_ + suffix;
  Patch patch{.name = name,
              .file = file_name(path),
              .vertex_count = positions_.size(),
              .index_count = indices_.size(),
              .stands = stands.size(),
              .lower = positions_.front(),
              .upper = positions_.front()};
  for (const Point& p : positions_) {
    for (int axis = 0; axis < 3; ++axis) {
      patch.lower[axis] = std::min(patch.lower[axis], p[axis]);
      patch.upper[axis] = std::max(patch.upper[axis], p[axis]);
    }
  }
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile bin, storage::AtomicFile::create(path));
  RAYMILL_RETURN_IF_ERROR(bin.write(std::as_bytes(std::span(positions_))));
  RAYMILL_RETURN_IF_ERROR(bin.write(std::as_bytes(std::span(indices_))));
  RAYMILL_RETURN_IF_ERROR(write_column(bin, stands, &Stand::translation));
  RAYMILL_RETURN_IF_ERROR(write_column(bin, stands, &Stand::rotation));
  RAYMILL_RETURN_IF_ERROR(write_column(bin, stands, &Stand::scale));
  RAYMILL_RETURN_IF_ERROR(bin.commit());
  triangles_ += stands.empty() ? 0 : (stands.size() - 1) * (indices_.size() / 3);
  bytes_ += bin.written_bytes();
  written_.push_back(path);
  patches_.push_back(std::move(patch));
  positions_.clear();
  indices_.clear();
  if (observer_ && !observer_(triangles_)) {
    return {ErrorCode::interrupted, "generation was stopped"};
  }
  return {};
}

void SceneWriter::add_camera(const std::string& name, const Camera& camera) { cameras_.push_back({name, camera}); }

Status SceneWriter::finish() {
  using nlohmann::json;
  RAYMILL_RETURN_IF_ERROR(end_patch("last"));
  json nodes = json::array(), meshes = json::array(), accessors = json::array(), views = json::array(),
       buffers = json::array(), cameras = json::array(), roots = json::array();
  bool placed = false;
  for (const Patch& patch : patches_) {
    const std::uint64_t position_bytes = patch.vertex_count * sizeof(Point);
    const std::uint64_t index_bytes = patch.index_count * sizeof(std::uint32_t);
    const std::size_t view = views.size();
    views.push_back({{"buffer", buffers.size()}, {"byteLength", position_bytes}, {"target", kArrayBuffer}});
    views.push_back({{"buffer", buffers.size()},
                     {"byteOffset", position_bytes},
                     {"byteLength", index_bytes},
                     {"target", kElementArrayBuffer}});
    buffers.push_back(
        {{"uri", patch.file}, {"byteLength", position_bytes + index_bytes + patch.stands * sizeof(Stand)}});
    accessors.push_back({{"bufferView", view},
                         {"componentType", kFloat},
                         {"count", patch.vertex_count},
                         {"type", "VEC3"},
                         {"min", patch.lower},
                         {"max", patch.upper}});
    accessors.push_back(
        {{"bufferView", view + 1}, {"componentType", kUnsignedInt}, {"count", patch.index_count}, {"type", "SCALAR"}});
    roots.push_back(nodes.size());
    json primitive = {{"attributes", {{"POSITION", accessors.size() - 2}}}, {"indices", accessors.size() - 1}};
    json node = {{"name", patch.name}, {"mesh", meshes.size()}};
    std::uint64_t offset = position_bytes + index_bytes;
    const auto add_column = [&](const char* attribute, const char* type, std::size_t element_bytes) {
      node["extensions"][kInstancing]["attributes"][attribute] = accessors.size();
      accessors.push_back(
          {{"bufferView", views.size()}, {"componentType", kFloat}, {"count", patch.stands}, {"type", type}});
      views.push_back(
          {{"buffer", buffers.size() - 1}, {"byteOffset", offset}, {"byteLength", patch.stands * element_bytes}});
      offset += patch.stands * element_bytes;
    };
    if (patch.stands > 0) {
      placed = true;
      add_column("TRANSLATION", "VEC3", sizeof(Stand::translation));
      add_column("ROTATION", "VEC4", sizeof(Stand::rotation));
      add_column("SCALE", "VEC3", sizeof(Stand::scale));
    }
    nodes.push_back(std::move(node));
    meshes.push_back({{"name", patch.name}, {"primitives", json::array({std::move(primitive)})}});
  }
  for (const SceneCamera& entry : cameras_) {
    roots.push_back(nodes.size());
    nodes.push_back({{"name", entry.name}, {"camera", cameras.size()}, {"matrix", matrix_of(entry.camera)}});
    cameras.push_back({{"name", entry.name},
                       {"type", "perspective"},
                       {"perspective", {{"yfov", 2 * std::atan(entry.camera.half_height)}, {"znear", 0.1}}}});
  }
  json root = {{"asset", {{"version", "2.0"}, {"generator", "raymill generate"}}},
               {"scene", 0},
               {"scenes", json::array({{{"nodes", roots}}})},
               {"nodes", nodes},
               {"meshes", meshes},
               {"accessors", accessors},
               {"bufferViews", views},
               {"buffers", buffers}};
  if (!cameras.empty()) {
    root["cameras"] = cameras;
  }
  if (placed) {
    root["extensionsUsed"] = root["extensionsRequired"] = json::array({kInstancing});
  }
  const std::string text = root.dump(1) + "\n";
  RAYMILL_RETURN_IF_ERROR(file_.write(std::as_bytes(std::span(text))));
  RAYMILL_RETURN_IF_ERROR(file_.commit());
  bytes_ += text.size();
  written_.clear();
  return {};
}

}  // namespace raymill::client
