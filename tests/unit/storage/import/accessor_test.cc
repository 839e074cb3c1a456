#include <gtest/gtest.h>

#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using nlohmann::json;

TEST(Accessor, InterleavedPositions) {
  TestScene scene;
  // position, normal
  const int view = scene.view(std::vector<float>{0, 0, 0, 9, 9, 9, 1, 0, 0, 9, 9, 9, 0, 1, 0, 9, 9,
                                                 9, 0, 0, 1, 9, 9, 9, 1, 0, 1, 9, 9, 9, 0, 1, 1},
                              24);
  scene.show(scene.accessor(view, kFloat, "VEC3", 6));
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(corners(imported.triangles[0]), (std::vector<float>{0, 0, 0, 1, 0, 0, 0, 1, 0}));
  EXPECT_EQ(corners(imported.triangles[1]), (std::vector<float>{0, 0, 1, 1, 0, 1, 0, 1, 1}));
}

TEST(Accessor, InterleavedAcrossManyPieces) {
  constexpr int kCount = 30000;
  std::vector<float> interleaved;
  for (int i = 0; i < kCount; ++i) {
    const auto x = static_cast<float>(i);
    interleaved.insert(interleaved.end(), {x, static_cast<float>(i % 3), static_cast<float>(i % 2), -1, -1});
  }
  TestScene scene;
  scene.show(scene.accessor(scene.view(interleaved, 20), kFloat, "VEC3", kCount));
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.report.triangles, kCount / 3U);
  for (const Triangle& triangle : imported.triangles) {
    ASSERT_EQ(triangle.v[1].x, static_cast<float>(triangle.primitive_id * 3 + 1));
    ASSERT_EQ(triangle.v[1].y, 1.0F);
  }
}

TEST(Accessor, SparsePositionsReplaceAndStartFromZero) {
  TestScene scene;
  const int replaced = scene.positions(vertices(6));
  const int from_zero = scene.accessor(-1, kFloat, "VEC3", 6);
  const json sparse = {
      {"count", 2},
      {"indices", {{"bufferView", scene.view(std::vector<std::uint16_t>{1, 5})}, {"componentType", kUnsignedShort}}},
      {"values", {{"bufferView", scene.view(std::vector<float>{7, 8, 9, -1, -2, -3})}}}};
  scene.root["accessors"][replaced]["sparse"] = sparse;
  scene.root["accessors"][from_zero]["sparse"] = sparse;
  scene.show(replaced);
  scene.show(from_zero);
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 2U);
  EXPECT_EQ(corners(imported.triangles[0]), (std::vector<float>{0, 0, 1, 7, 8, 9, 2, 4, 1}));
  EXPECT_EQ(corners(imported.triangles[1]), (std::vector<float>{3, 9, 1, 4, 16, 1, -1, -2, -3}));
  EXPECT_EQ(imported.report.counts.at(ImportCode::sparse_accessors), 2U);
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_degenerate), 2U);
}

TEST(Accessor, SparseIndices) {
  TestScene scene;
  const int positions = scene.positions(vertices(4));
  const int indices = scene.indices(std::vector<std::uint8_t>{0, 1, 2});
  scene.root["accessors"][indices]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", scene.view(std::vector<std::uint8_t>{2})}, {"componentType", kUnsignedByte}}},
      {"values", {{"bufferView", scene.view(std::vector<std::uint8_t>{3})}}}};
  scene.show(positions, indices);
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(vertex_numbers(imported.triangles[0]), (std::vector<int>{0, 1, 3}));
}

TEST(Accessor, BrokenSparseIsRefused) {
  const auto import_sparse = [](const std::vector<std::uint16_t>& indices, int count, int component_type,
                                int values_offset, int stride) {
    TestScene scene;
    const int positions = scene.positions(vertices(6));
    scene.root["accessors"][positions]["sparse"] = {
        {"count", count},
        {"indices", {{"bufferView", scene.view(indices)}, {"componentType", component_type}}},
        {"values",
         {{"bufferView", scene.view(std::vector<float>{7, 8, 9, -1, -2, -3}, stride)}, {"byteOffset", values_offset}}}};
    scene.show(positions);
    return import_bytes(scene.text()).status;
  };
  EXPECT_TRUE(import_sparse({1, 5}, 2, kUnsignedShort, 0, 0).ok());
  const Status unsorted = import_sparse({5, 1}, 2, kUnsignedShort, 0, 0);
  EXPECT_NE(unsorted.message().find("accessors[0].sparse.indices holds 1 at 1"), std::string::npos)
      << unsorted.message();
  EXPECT_FALSE(import_sparse({1, 1}, 2, kUnsignedShort, 0, 0).ok());
  EXPECT_FALSE(import_sparse({1, 6}, 2, kUnsignedShort, 0, 0).ok());
  EXPECT_FALSE(import_sparse({1, 5}, 3, kUnsignedShort, 0, 0).ok());
  EXPECT_FALSE(import_sparse({1, 5}, 7, kUnsignedShort, 0, 0).ok());
  EXPECT_FALSE(import_sparse({1, 5}, 2147483647, kUnsignedShort, 0, 0).ok());
  EXPECT_FALSE(import_sparse({1, 5}, 2, kFloat, 0, 0).ok());
  EXPECT_FALSE(import_sparse({1, 5}, 2, kUnsignedShort, 4, 0).ok());
  EXPECT_FALSE(import_sparse({1, 5}, 2, kUnsignedShort, 0, 12).ok());
}

template <typename T>
Imported import_quantized(const std::vector<T>& xyz, int component_type, bool normalized, bool declared) {
  TestScene scene;
  // Vertices start at multiples of four bytes, as the extension demands.
  std::vector<T> padded;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    padded.insert(padded.end(), {xyz[i], xyz[i + 1], xyz[i + 2], 0});
  }
  const int positions = scene.accessor(scene.view(padded, 4 * sizeof(T)), component_type, "VEC3", xyz.size() / 3);
  scene.root["accessors"][positions]["normalized"] = normalized;
  if (declared) {
    scene.root["extensionsUsed"] = {"KHR_mesh_quantization"};
    scene.root["extensionsRequired"] = {"KHR_mesh_quantization"};
  }
  scene.show(positions);
  return import_bytes(scene.text());
}

TEST(Accessor, QuantizedPositions) {
  const auto check = [](const Imported& imported, const std::vector<float>& expected) {
    ASSERT_TRUE(imported.status.ok()) << imported.status.message();
    ASSERT_EQ(imported.triangles.size(), 1U);
    EXPECT_EQ(corners(imported.triangles[0]), expected);
    EXPECT_EQ(imported.report.counts.at(ImportCode::quantized_positions), 1U);
    EXPECT_TRUE(imported.report.ignored_extensions.empty());
  };
  check(import_quantized<std::int8_t>({-128, 127, 0, -127, 1, 64, 0, 0, 1}, kByte, true, true),
        {-1, 1, 0, -1, 1.0F / 127, float(64.0 / 127), 0, 0, 1.0F / 127});
  check(import_quantized<std::int8_t>({-128, 127, 0, -127, 1, 64, 0, 0, 1}, kByte, false, true),
        {-128, 127, 0, -127, 1, 64, 0, 0, 1});
  check(import_quantized<std::uint8_t>({0, 255, 51, 1, 2, 3, 0, 0, 1}, kUnsignedByte, true, true),
        {0, 1, 0.2F, float(1 / 255.0), float(2 / 255.0), float(3 / 255.0), 0, 0, float(1 / 255.0)});
  check(import_quantized<std::int16_t>({-32768, 32767, 0, 1, 2, 3, 0, 0, 1}, kShort, true, true),
        {-1, 1, 0, float(1 / 32767.0), float(2 / 32767.0), float(3 / 32767.0), 0, 0, float(1 / 32767.0)});
  check(import_quantized<std::uint16_t>({0, 65535, 13107, 1, 2, 3, 0, 0, 1}, kUnsignedShort, true, true),
        {0, 1, 0.2F, float(1 / 65535.0), float(2 / 65535.0), float(3 / 65535.0), 0, 0, float(1 / 65535.0)});
}

TEST(Accessor, IntegerPositionsNeedTheExtension) {
  const Status status =
      import_quantized<std::uint16_t>({0, 0, 0, 1, 0, 0, 0, 1, 0}, kUnsignedShort, true, false).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("KHR_mesh_quantization"), std::string::npos) << status.message();
}

TEST(Accessor, PastItsViewIsRefused) {
  TestScene scene;
  const int positions = scene.positions(vertices(12));
  scene.root["accessors"][positions]["byteOffset"] = 120;
  scene.root["accessors"][positions]["count"] = 3;
  scene.show(positions);
  const Imported imported = import_bytes(scene.text());
  EXPECT_EQ(imported.status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(
      imported.status.message(),
      "test.gltf: meshes[0].primitives[0]: accessors[0] reads bytes 120..156 past its bufferViews[0] of 144 bytes; "
      "the file is damaged or was cut short");
}

TEST(Accessor, ViewPastItsBufferIsRefused) {
  TestScene scene;
  scene.show(scene.positions(vertices(3)));
  scene.root["bufferViews"][0]["byteLength"] = 37;
  const Status status = import_bytes(scene.text()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("bufferViews[0] takes bytes 0..37 of buffers[0], which has 36"), std::string::npos)
      << status.message();
}

TEST(Accessor, StrideBelowTheElementIsRefused) {
  TestScene scene;
  scene.show(scene.accessor(scene.view(vertices(3), 8), kFloat, "VEC3", 3));
  EXPECT_EQ(import_bytes(scene.text()).status.code(), ErrorCode::bad_scene);
}

TEST(Accessor, WithoutAViewIsAllZero) {
  TestScene scene;
  scene.show(scene.accessor(-1, kFloat, "VEC3", 3));
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok());
  EXPECT_EQ(imported.report.counts.at(ImportCode::dropped_degenerate), 1U);
}

TEST(Accessor, WrongTypesAreRefused) {
  for (const auto& [component_type, type] : std::map<int, const char*>{
           {kFloat, "VEC2"}, {5124, "VEC3"}, {5130, "VEC3"}, {0, "VEC3"}, {kUnsignedInt, "VEC3"}}) {
    TestScene scene;
    scene.show(scene.accessor(scene.view(vertices(9)), component_type, type, 3));
    EXPECT_EQ(import_bytes(scene.text()).status.code(), ErrorCode::bad_scene) << component_type;
  }
  TestScene scene;
  const int positions = scene.positions(vertices(3));
  scene.show(positions, scene.accessor(scene.view(std::vector<float>{0, 1, 2}), kFloat, "SCALAR", 3));
  EXPECT_EQ(import_bytes(scene.text()).status.code(), ErrorCode::bad_scene);
}

}  // namespace
}  // namespace raymill::storage
