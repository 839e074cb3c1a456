#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using nlohmann::json;

TestScene small_scene() {
  TestScene scene;
  const int positions = scene.positions(vertices(3));
  scene.show(positions, scene.indices(std::vector<std::uint16_t>{0, 1, 2}));
  return scene;
}

// Changes one field of a good scene and expects the whole sentence.
void expect_refused(const char* pointer, json value, const std::string& sentence) {
  TestScene scene = small_scene();
  scene.root[json::json_pointer(pointer)] = std::move(value);
  const Imported imported = import_bytes(scene.text());
  EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(imported.status.message(), "test.gltf: " + sentence);
  EXPECT_TRUE(imported.triangles.empty());
}

TEST(BadInput, NegativeIndices) {
  expect_refused("/nodes/0/mesh", -1, "nodes[0].mesh is -1; a whole number from 0 to 2147483647 is needed");
  expect_refused("/scenes/0/nodes/0", -7, "scenes[0].nodes[0] is -7; a whole number from 0 to 2147483647 is needed");
  expect_refused("/meshes/0/primitives/0/indices", -2,
                 "meshes[0].primitives[0].indices is -2; a whole number from 0 to 2147483647 is needed");
  expect_refused("/accessors/0/byteOffset", -4,
                 "accessors[0].byteOffset is -4; a whole number from 0 to 9007199254740992 is needed");
}

TEST(BadInput, MissingElements) {
  expect_refused("/accessors/1/bufferView", 2, "accessors[1].bufferView is 2 and the file has 2 bufferViews");
  expect_refused("/bufferViews/1/buffer", 1, "bufferViews[1].buffer is 1 and the file has 1 buffers");
  expect_refused("/nodes/0/skin", 0, "nodes[0].skin is 0 and the file has no skins");
  expect_refused("/nodes/0/children", {1}, "nodes[0].children[0] is 1 and the file has 1 nodes");
  expect_refused("/meshes/0/primitives/0/attributes/POSITION", 9,
                 "meshes[0].primitives[0].attributes.POSITION is 9 and the file has 2 accessors");
  expect_refused("/scene", 1, "scene is 1 and the file has 1 scenes");
}

TEST(BadInput, HugeCounts) {
  for (const json& count : {json(1099511627776), json(-1), json(2.5), json(1e300), json("3"), json(nullptr)}) {
    TestScene scene = small_scene();
    scene.root["accessors"][0]["count"] = count;
    const Imported imported = import_bytes(scene.text(), {}, mebibytes(8));
    EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene) << count;
    EXPECT_NE(imported.status.message().find("accessors[0].count"), std::string::npos) << imported.status.message();
  }
  TestScene scene = small_scene();
  scene.root["accessors"][0]["count"] = 4294967295;
  EXPECT_EQ(import_bytes(scene.text(), {}, mebibytes(8)).status.code(), ErrorCode::bad_scene);
  // No view to run past: what stops it is the budget, before anything is allocated.
  scene.root["accessors"][0].erase("bufferView");
  EXPECT_EQ(import_bytes(scene.text(), {}, mebibytes(8)).status.code(), ErrorCode::budget_exceeded);
}

TEST(BadInput, WrongTypesOfFields) {
  expect_refused("/nodes", 5, "nodes is 5; an array is needed");
  expect_refused("/nodes/0", json::array(), "nodes[0] is an array; an object is needed");
  expect_refused("/nodes/0/matrix", {1, 2, 3}, "nodes[0].matrix has 3 numbers; it must have 16");
  expect_refused("/nodes/0/matrix", true, "nodes[0].matrix is true; an array is needed");
  expect_refused("/nodes/0/translation", {1, 2, "3"}, "nodes[0].translation[2] is \"3\"; a number is needed");
  expect_refused("/accessors/0/type", "VEC5",
                 "accessors[0].type is \"VEC5\"; SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4 is needed");
  expect_refused("/bufferViews/0/byteStride", 13, "bufferViews[0].byteStride is 13; a multiple of 4 is needed");
  expect_refused("/bufferViews/0/byteStride", 256,
                 "bufferViews[0].byteStride is 256; a whole number from 0 to 252 is needed");
  expect_refused("/asset/version", 2, "asset.version is 2; a string is needed");
}

TEST(BadInput, MissingFields) {
  TestScene scene = small_scene();
  scene.root["meshes"][0]["primitives"][0].erase("attributes");
  EXPECT_EQ(import_bytes(scene.text()).status.message(), "test.gltf: meshes[0].primitives[0].attributes is missing");
  scene = small_scene();
  scene.root.erase("asset");
  EXPECT_EQ(import_bytes(scene.text()).status.message(), "test.gltf: asset is missing");
}

TEST(BadInput, WholeNumbersMayBeWrittenAsFloats) {
  TestScene scene = small_scene();
  scene.root["accessors"][0]["count"] = 3.0;
  scene.root["nodes"][0]["mesh"] = 0.0;
  EXPECT_EQ(import_bytes(scene.text()).triangles.size(), 1U);
}

TEST(BadInput, NamesThatAreNoStringsDoNotMatter) {
  TestScene scene = small_scene();
  scene.root["nodes"][0]["name"] = 7;
  EXPECT_EQ(import_bytes(scene.text()).triangles.size(), 1U);
}

TEST(BadInput, BrokenText) {
  const std::string text = small_scene().text();
  for (const std::string& broken :
       {std::string(), std::string("{"), std::string("null"), std::string("[1]"), text.substr(0, text.size() / 2),
        text + "x", std::string("\xff\xfe{}"), std::string(300000, '['),
        std::string("{\"asset\":{\"version\":\"2.0\"},\"scene\":1e999}")}) {
    const Status status = import_bytes(broken).status;
    EXPECT_EQ(status.code(), ErrorCode::bad_scene) << broken.substr(0, 20);
    EXPECT_TRUE(status.message().starts_with("test.gltf: "));
  }
}

TEST(BadInput, DeepExtrasAreRefusedAndShallowOnesIgnored) {
  TestScene scene = small_scene();
  json extras = 1;
  for (int i = 0; i < 60; ++i) {
    extras = json::array({std::move(extras)});
  }
  scene.root["extras"] = extras;
  EXPECT_TRUE(import_bytes(scene.text()).status.ok());
  std::string text = scene.text();
  std::string deep = "\"deep\":";
  deep.append(100000, '[').append(100000, ']').append(",");
  text.insert(1, deep);
  const Status status = import_bytes(text).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("nested deeper"), std::string::npos) << status.message();
}

TEST(BadInput, RequiredExtensionsAreRefusedByName) {
  for (const char* name : {"MPEG_mesh_linking", "VENDOR_unknown"}) {
    TestScene scene = small_scene();
    scene.root["extensionsRequired"] = {name};
    scene.root["extensionsUsed"] = {name};
    const Status status = import_bytes(scene.text()).status;
    EXPECT_EQ(status.code(), ErrorCode::unsupported);
    EXPECT_NE(status.message().find(name), std::string::npos) << status.message();
  }
}

TEST(BadInput, ShadingExtensionsAndOptionalOnesAreCounted) {
  TestScene scene = small_scene();
  scene.root["extensionsRequired"] = {"KHR_texture_transform", "KHR_materials_unlit"};
  scene.root["extensionsUsed"] = {"KHR_texture_transform", "KHR_materials_unlit", "EXT_other"};
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.at(ImportCode::extension_ignored), 3U);
  EXPECT_EQ(imported.report.ignored_extensions,
            (std::vector<std::string>{"EXT_other", "KHR_materials_unlit", "KHR_texture_transform"}));
}

TEST(BadInput, OtherVersionsOfGltf) {
  const auto import_version = [](const json& asset) {
    TestScene scene = small_scene();
    scene.root["asset"] = asset;
    return import_bytes(scene.text()).status.code();
  };
  EXPECT_EQ(import_version({{"version", "1.0"}}), ErrorCode::unsupported);
  EXPECT_EQ(import_version({{"version", "3.0"}}), ErrorCode::unsupported);
  EXPECT_EQ(import_version({{"version", "2.1"}, {"minVersion", "2.1"}}), ErrorCode::unsupported);
  EXPECT_EQ(import_version({{"version", "2.1"}, {"minVersion", "2.0"}}), ErrorCode::ok);
  EXPECT_EQ(import_version({{"version", "2.1"}}), ErrorCode::ok);
  EXPECT_EQ(import_version({{"version", "two"}}), ErrorCode::bad_scene);
  EXPECT_EQ(import_version({{"version", ""}}), ErrorCode::bad_scene);
  EXPECT_EQ(import_version(json::object()), ErrorCode::bad_scene);
}

TEST(BadInput, EveryCutOfATextIsRefusedOrRead) {
  const std::string text = small_scene().text();
  for (std::size_t size = 0; size < text.size(); ++size) {
    const Status status = import_bytes(text.substr(0, size)).status;
    ASSERT_EQ(status.code(), ErrorCode::bad_scene) << size;
  }
}

TEST(BadInput, ImagesMaterialsAndAnimationsAreNotRead) {
  TestScene scene = small_scene();
  scene.root["images"] = {{{"uri", "missing.png"}}, {{"bufferView", 77}}, {{"uri", "data:image/png;base64,!!"}}};
  scene.root["textures"] = {{{"source", 900}}};
  scene.root["materials"] = 7;
  scene.root["animations"] = {{{"channels", "broken"}}};
  scene.root["meshes"][0]["primitives"][0]["material"] = -5;
  scene.root["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 1000;
  EXPECT_EQ(import_bytes(scene.text()).triangles.size(), 1U);
}

TEST(BadInput, BudgetIsClaimedBeforeTheMemory) {
  TestScene scene = small_scene();
  const Imported imported = import_bytes(scene.text(), {}, kibibytes(64));
  EXPECT_EQ(imported.status.code(), ErrorCode::budget_exceeded);
  EXPECT_TRUE(imported.status.message().starts_with("test.gltf: ")) << imported.status.message();
}

TEST(BadInput, AnErrorOfTheSinkPassesAsItIs) {
  struct : TriangleSink {
    Status add(std::span<const Triangle> /*triangles*/) override { return {ErrorCode::disk_full, "no space left"}; }
  } sink;
  for (const int vertex_count : {3, 300000}) {
    TestScene scene;
    scene.show(scene.positions(vertices(vertex_count)));
    const std::string text = scene.text();
    Ledger ledger(mebibytes(256));
    ImportReport report;
    const Status status = import_gltf_memory(std::as_bytes(std::span(text)), "test.gltf", {}, ledger, sink, report);
    EXPECT_EQ(status.code(), ErrorCode::disk_full);
    EXPECT_EQ(status.message(), "no space left");
  }
}

}  // namespace
}  // namespace raymill::storage
