#include "tests/unit/storage/import/test_scene.h"

#include <gtest/gtest.h>

namespace raymill::storage {

namespace {

using nlohmann::json;

class Collector final : public TriangleSink {
 public:
  explicit Collector(Imported& out) : out_(out) {}
  Status add(std::span<const Triangle> triangles) override {
    out_.largest_piece = std::max(out_.largest_piece, triangles.size());
    out_.triangles.insert(out_.triangles.end(), triangles.begin(), triangles.end());
    return {};
  }

 private:
  Imported& out_;
};

std::string base64(std::span<const std::byte> bytes) {
  constexpr const char* kAlphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      bits = bits << 8 | (i + k < bytes.size() ? std::to_integer<std::uint32_t>(bytes[i + k]) : 0);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += i + k <= bytes.size() ? kAlphabet[bits >> (18 - 6 * k) & 63] : '=';
    }
  }
  return text;
}

void append_word(std::string& text, std::uint64_t word) {
  for (int shift = 0; shift < 32; shift += 8) {
    text += static_cast<char>(word >> shift & 0xFF);
  }
}

}  // namespace

TestScene::TestScene() {
  root = {{"asset", {{"version", "2.0"}}}, {"scene", 0}, {"buffers", json::array({{{"byteLength", 0}}})}};
  root["scenes"] = json::array({{{"nodes", json::array()}}});
  for (const char* section : {"bufferViews", "accessors", "meshes", "nodes"}) {
    root[section] = json::array();
  }
}

int TestScene::view_of(std::span<const std::byte> bytes, int stride_bytes) {
  buffer.resize((buffer.size() + 3) / 4 * 4);
  json view = {{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes.size()}};
  if (stride_bytes != 0) {
    view["byteStride"] = stride_bytes;
  }
  buffer.insert(buffer.end(), bytes.begin(), bytes.end());
  root["buffers"][0]["byteLength"] = buffer.size();
  root["bufferViews"].push_back(std::move(view));
  return static_cast<int>(root["bufferViews"].size()) - 1;
}

int TestScene::accessor(int view, int component_type, const char* type, std::uint64_t count) {
  json accessor = {{"componentType", component_type}, {"type", type}, {"count", count}};
  if (view >= 0) {
    accessor["bufferView"] = view;
  }
  root["accessors"].push_back(std::move(accessor));
  return static_cast<int>(root["accessors"].size()) - 1;
}

int TestScene::positions(const std::vector<float>& xyz) { return accessor(view(xyz), kFloat, "VEC3", xyz.size() / 3); }

int TestScene::show(int positions, int indices, int mode) {
  json primitive = {{"attributes", {{"POSITION", positions}}}, {"mode", mode}};
  if (indices >= 0) {
    primitive["indices"] = indices;
  }
  root["meshes"].push_back({{"primitives", json::array({primitive})}});
  root["nodes"].push_back({{"mesh", root["meshes"].size() - 1}});
  const int node = static_cast<int>(root["nodes"].size()) - 1;
  root["scenes"][0]["nodes"].push_back(node);
  return node;
}

std::string TestScene::text() const {
  json embedded = root;
  embedded["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64(buffer);
  return embedded.dump();
}

std::string TestScene::glb() const {
  std::string json_text = root.dump();
  json_text.resize((json_text.size() + 3) / 4 * 4, ' ');
  std::string binary(reinterpret_cast<const char*>(buffer.data()), buffer.size());
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  std::string glb = "glTF";
  append_word(glb, 2);
  append_word(glb, 12 + 8 + json_text.size() + 8 + binary.size());
  append_word(glb, json_text.size());
  glb += "JSON" + json_text;
  append_word(glb, binary.size());
  glb += std::string("BIN\0", 4) + binary;
  return glb;
}

Imported import_bytes(const std::string& bytes, const ImportOptions& options, std::uint64_t budget_bytes,
                      const std::string& name) {
  Imported imported;
  Collector collector(imported);
  Ledger ledger(budget_bytes);
  imported.status =
      import_scene_memory(std::as_bytes(std::span(bytes)), name, options, ledger, collector, imported.report);
  EXPECT_EQ(ledger.used_bytes(Tag::build), 0U);
  return imported;
}

Imported import_path(const std::string& path, const ImportOptions& options, std::uint64_t budget_bytes) {
  Imported imported;
  Collector collector(imported);
  Ledger ledger(budget_bytes);
  imported.status = import_scene(path, options, ledger, collector, imported.report);
  return imported;
}

std::vector<float> corners(const Triangle& triangle) {
  std::vector<float> numbers;
  for (const Vec3f& p : triangle.v) {
    numbers.insert(numbers.end(), {p.x, p.y, p.z});
  }
  return numbers;
}

std::vector<float> vertices(int count) {
  std::vector<float> xyz;
  for (int i = 0; i < count; ++i) {
    const auto x = static_cast<float>(i);
    xyz.insert(xyz.end(), {x, x * x, 1});  // on a parabola: no three in a row
  }
  return xyz;
}

std::vector<int> vertex_numbers(const Triangle& triangle) {
  return {static_cast<int>(triangle.v[0].x), static_cast<int>(triangle.v[1].x), static_cast<int>(triangle.v[2].x)};
}

}  // namespace raymill::storage
