// Meshes that are placed: by many nodes, by EXT_mesh_gpu_instancing, and what becomes of them under each rule.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

class Objects final : public InstanceSink {
 public:
  Status begin_object() override {
    ++open_;
    return {};
  }
  Result<Object> end_object() override {
    --open_;
    Object object{count_++, {}};
    object.box.grow(Vec3f{0, 0, 0});
    object.box.grow(Vec3f{1, 1, 1});
    return object;
  }
  Status place(const Placed& placed) override {
    placements.push_back(placed);
    return {};
  }
  [[nodiscard]] std::uint32_t count() const { return open_ == 0 ? count_ : 0; }
  std::vector<Placed> placements;

 private:
  std::uint32_t count_ = 0;
  int open_ = 0;
};

// One triangle of the unit box, placed by `nodes` nodes, the i-th of them at x = 10 i.
TestScene many_nodes(int nodes) {
  TestScene scene;
  scene.show(scene.positions({1, 0, 0, 0, 1, 0, 0, 0, 1}));
  for (int i = 1; i < nodes; ++i) {
    scene.root["nodes"].push_back({{"mesh", 0}, {"translation", {10 * i, 0, 0}}});
    scene.root["scenes"][0]["nodes"].push_back(i);
  }
  return scene;
}

void instance(TestScene& scene, const std::vector<float>& translations, const std::vector<float>& rotations,
              const std::vector<float>& scales) {
  auto& attributes = scene.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
  const auto add = [&](const char* name, const std::vector<float>& values, const char* type, std::size_t components) {
    if (!values.empty()) {
      attributes[name] = scene.accessor(scene.view(values), kFloat, type, values.size() / components);
    }
  };
  add("TRANSLATION", translations, "VEC3", 3);
  add("ROTATION", rotations, "VEC4", 4);
  add("SCALE", scales, "VEC3", 3);
  scene.root["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
}

TEST(InstanceImport, AMeshThatIsPlacedOftenIsAnObjectWhereTheRuleSaysSo) {
  for (const InstanceRule rule : {InstanceRule::always, InstanceRule::never, InstanceRule::automatic}) {
    Objects objects;
    const Imported imported = import_bytes(many_nodes(5).text(), {{}, rule, &objects});
    ASSERT_TRUE(imported.status.ok()) << imported.status.message();
    // A triangle is smaller than an instance.
    const bool placed = rule == InstanceRule::always;
    EXPECT_EQ(objects.count(), placed ? 1U : 0U);
    EXPECT_EQ(objects.placements.size(), placed ? 5U : 0U);
    EXPECT_EQ(imported.triangles.size(), placed ? 1U : 5U);
    EXPECT_EQ(imported.report.geometries.size(), 5U) << "ids do not depend on the rule";
    EXPECT_EQ(imported.report.kept, 5U);
    for (std::uint32_t i = 0; i < objects.placements.size(); ++i) {
      EXPECT_EQ(objects.placements[i].geometry_base, i);
      EXPECT_EQ(objects.placements[i].instance_id, i);
      EXPECT_EQ(objects.placements[i].world_from_object[9], 10.0 * i);
    }
  }
}

TEST(InstanceImport, AutomaticTakesWhatIsHalfAsLarge) {
  for (const int triangles : {8, 200}) {
    TestScene scene;
    scene.show(scene.positions(vertices(3 * triangles)));
    for (int i = 1; i < 9; ++i) {
      scene.root["nodes"].push_back({{"mesh", 0}});
      scene.root["scenes"][0]["nodes"].push_back(i);
    }
    Objects objects;
    const Imported imported = import_bytes(scene.text(), {{}, InstanceRule::automatic, &objects});
    ASSERT_TRUE(imported.status.ok());
    EXPECT_EQ(objects.placements.size(), triangles == 200 ? 9U : 0U);
  }
}

TEST(InstanceImport, TheExtensionPlacesAMeshInItsNodesSpace) {
  const float half = std::sqrt(0.5F);
  for (const bool flat : {false, true}) {
    TestScene scene = many_nodes(1);
    scene.root["nodes"][0]["translation"] = {100, 0, 0};
    instance(scene, {1, 2, 3, 4, 5, 6}, {0, 0, half, half, 0, 0, 0, 1}, {2, 2, 2, 1, 1, -1});
    Objects objects;
    const Imported imported =
        import_bytes(scene.text(), {{}, flat ? InstanceRule::never : InstanceRule::always, &objects});
    ASSERT_TRUE(imported.status.ok()) << imported.status.message();
    EXPECT_EQ(imported.report.counts.at(ImportCode::gpu_instances), 2U);
    EXPECT_EQ(imported.report.geometry_count, 2U);
    ASSERT_EQ(imported.report.geometries.size(), 1U);
    EXPECT_EQ(imported.report.geometries[0].copies, 2U);
    EXPECT_EQ(imported.report.geometries[0].triangles, 2U);
    if (!flat) {
      ASSERT_EQ(objects.placements.size(), 2U);
      EXPECT_NEAR(objects.placements[0].world_from_object[1], 2, 1e-6) << "x becomes y, twice as long";
      EXPECT_EQ(objects.placements[1].world_from_object[8], -1);
      EXPECT_EQ(objects.placements[1].world_from_object[9], 104);
      continue;
    }
    ASSERT_EQ(imported.triangles.size(), 2U);
    EXPECT_EQ(imported.triangles[1].geometry_id, 1U);
    EXPECT_EQ(imported.triangles[1].primitive_id, 0U);
    EXPECT_EQ(corners(imported.triangles[1]), (std::vector<float>{105, 5, 6, 104, 6, 6, 104, 5, 5}));
  }
}

TEST(InstanceImport, WhatCannotBeInvertedBecomesTriangles) {
  TestScene scene = many_nodes(3);
  scene.root["nodes"][1]["scale"] = {1, 1, 0};  // its shadow on the plane z = 0 still has an area
  Objects objects;
  const Imported imported = import_bytes(scene.text(), {{}, InstanceRule::always, &objects});
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(objects.placements.size(), 2U);
  ASSERT_EQ(imported.triangles.size(), 2U) << "the object's and the flat one";
  EXPECT_EQ(imported.triangles[1].geometry_id, 1U);
  EXPECT_EQ(objects.placements[1].geometry_base, 2U);
}

TEST(InstanceImport, BrokenAttributesAreRefused) {
  const auto message_of = [](const TestScene& scene) {
    const Imported imported = import_bytes(scene.text());
    EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene);
    return imported.status.message();
  };
  TestScene lengths = many_nodes(1);
  instance(lengths, {1, 2, 3, 4, 5, 6}, {}, {1, 1, 1});
  EXPECT_NE(message_of(lengths).find("elements"), std::string::npos);
  TestScene type = many_nodes(1);
  instance(type, {1, 2, 3}, {}, {});
  type.root["accessors"].back()["type"] = "VEC4";
  EXPECT_NE(message_of(type).find("VEC3"), std::string::npos);
  TestScene component = many_nodes(1);
  instance(component, {1, 2, 3}, {}, {});
  component.root["accessors"].back()["componentType"] = kShort;
  EXPECT_NE(message_of(component).find("component type"), std::string::npos);
  TestScene nowhere = many_nodes(1);
  instance(nowhere, {1, 2, 3}, {}, {});
  nowhere.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] = 99;
  EXPECT_NE(message_of(nowhere).find("99"), std::string::npos);
  TestScene none = many_nodes(1);
  none.root["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = nlohmann::json::object();
  EXPECT_NE(message_of(none).find("nodes[0]: EXT_mesh_gpu_instancing.attributes has none"), std::string::npos);
}

}  // namespace
}  // namespace raymill::storage
