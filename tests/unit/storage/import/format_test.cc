#include <gtest/gtest.h>

#include "storage/import/scene_format.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

SceneFormat format_of(const std::string& bytes, const std::string& name) {
  const auto format = detect_format(ByteSource::view(std::as_bytes(std::span(bytes))), name);
  EXPECT_TRUE(format.ok()) << format.status().message();
  return *format;
}

TEST(SceneFormat, FirstBytesSayMoreThanTheName) {
  EXPECT_EQ(format_of("glTF", "a.obj"), SceneFormat::gltf);
  EXPECT_EQ(format_of("\xEF\xBB\xBF {\"asset\"", "a.obj"), SceneFormat::gltf);
  EXPECT_EQ(format_of("ply\r\n", "a.stl"), SceneFormat::ply);
  EXPECT_EQ(format_of("solid x\nfacet", "a.obj"), SceneFormat::stl_text);
  EXPECT_EQ(format_of("Solid\tx\nfacet", "a"), SceneFormat::stl_text);
}

TEST(SceneFormat, NamesDecideWhereTheBytesDoNot) {
  EXPECT_EQ(format_of("v 0 0 0", "a.OBJ"), SceneFormat::obj);
  EXPECT_EQ(format_of("solidity", "a.obj"), SceneFormat::obj);
  EXPECT_EQ(format_of("plywood", "a.Ply"), SceneFormat::ply);
  EXPECT_EQ(format_of("", "a.glb"), SceneFormat::gltf);
  EXPECT_EQ(format_of("", "a.stl"), SceneFormat::stl_binary);
  const Imported unknown = import_named("picture.png", "\x89PNG");
  EXPECT_EQ(unknown.status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(
      unknown.status.message(),
      "picture.png: is no scene that Raymill knows by its first bytes or its name: .gltf, .glb, .ply, .obj, .stl");
}

TEST(SceneFormat, OnlyGltfHasScenes) {
  const Imported imported = import_bytes("v 0 0 0\n", {.scene = 1}, gibibytes(1), "a.obj");
  EXPECT_EQ(imported.status.code(), ErrorCode::invalid_argument);
  EXPECT_EQ(imported.status.message(), "a.obj: has no scene 1; it is no glTF file and holds one");
}

TEST(SceneFormat, ErrorsOfTheSinkPassAsTheyAre) {
  class Full final : public TriangleSink {
   public:
    Status add(std::span<const Triangle>) override { return {ErrorCode::disk_full, "no room"}; }
  };
  std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (int i = 0; i < 20000; ++i) {
    obj += "f 1 2 3\n";
  }
  Full full;
  ImportReport report;
  Ledger ledger(mebibytes(64));
  const Status status = import_scene_memory(std::as_bytes(std::span(obj)), "a.obj", {}, ledger, full, report);
  EXPECT_EQ(status.code(), ErrorCode::disk_full);
  EXPECT_EQ(status.message(), "no room");
}

TEST(SceneFormat, ALongReadOfVerticesCanBeStopped) {
  class Stopped final : public TriangleSink {
   public:
    Status add(std::span<const Triangle> triangles) override {
      EXPECT_TRUE(triangles.empty());
      return {ErrorCode::interrupted, "stopped"};
    }
  };
  std::string points;
  for (int i = 0; i < 70000; ++i) {
    points += "1 2 3\n";
  }
  std::string obj;
  for (std::size_t at = 0; at < points.size(); at += 6) {
    obj += "v " + points.substr(at, 6);
  }
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 70000\nproperty float x\nproperty float y\nproperty float z\n"
      "element face 1\nproperty list uchar int vertex_index\nend_header\n" +
      points + "3 0 1 2\n";
  for (const std::string& file : {obj, ply}) {
    Stopped stopped;
    ImportReport report;
    Ledger ledger(mebibytes(64));
    const Status status = import_scene_memory(std::as_bytes(std::span(file)), "a.obj", {}, ledger, stopped, report);
    EXPECT_EQ(status.code(), ErrorCode::interrupted);
    EXPECT_EQ(status.message(), "stopped");
  }
}

}  // namespace
}  // namespace raymill::storage
