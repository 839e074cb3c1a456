#include <draco/compression/decode.h>
#include <draco/compression/expert_encode.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/support/effort.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using nlohmann::json;

constexpr int kSide = 20;

// A wavy sheet of kSide * kSide vertices, as draco sees it; positions of `data_type`.
std::vector<char> encode(draco::MeshEncoderMethod method, draco::DataType data_type, bool metadata = false) {
  draco::Mesh mesh;
  mesh.set_num_points(kSide * kSide);
  draco::GeometryAttribute layout;
  layout.Init(draco::GeometryAttribute::POSITION, nullptr, 3, data_type, false, 3 * draco::DataTypeLength(data_type),
              0);
  const int id = mesh.AddAttribute(layout, true, kSide * kSide);
  mesh.attribute(id)->set_unique_id(7);
  for (int i = 0; i < kSide * kSide; ++i) {
    const int xyz[3] = {i % kSide, i / kSide, (i * 7) % 5};
    if (data_type == draco::DT_FLOAT32) {
      const float values[3] = {float(xyz[0]), float(xyz[1]), float(xyz[2])};
      mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), values);
    } else {
      const std::int16_t values[3] = {std::int16_t(xyz[0]), std::int16_t(xyz[1]), std::int16_t(xyz[2])};
      mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), values);
    }
  }
  for (int y = 0; y + 1 < kSide; ++y) {
    for (int x = 0; x + 1 < kSide; ++x) {
      const int a = y * kSide + x;
      mesh.AddFace({draco::PointIndex(a), draco::PointIndex(a + 1), draco::PointIndex(a + kSide)});
      mesh.AddFace({draco::PointIndex(a + 1), draco::PointIndex(a + kSide + 1), draco::PointIndex(a + kSide)});
    }
  }
  if (metadata) {
    auto entries = std::make_unique<draco::GeometryMetadata>();
    entries->AddEntryString("made-by", "a test");
    mesh.AddMetadata(std::move(entries));
  }
  draco::ExpertEncoder encoder(mesh);
  encoder.SetEncodingMethod(method);
  draco::EncoderBuffer out;
  EXPECT_TRUE(encoder.EncodeToBuffer(&out).ok());
  return {out.data(), out.data() + out.size()};
}

TestScene scene_of(const std::vector<char>& stream, int attribute_id = 7) {
  TestScene scene;
  const int view = scene.view(stream);
  const int positions = scene.accessor(-1, kFloat, "VEC3", kSide * kSide);
  const int indices = scene.accessor(-1, kUnsignedShort, "SCALAR", 6 * (kSide - 1) * (kSide - 1));
  const int node = scene.show(positions, indices);
  scene.root["meshes"][node]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = {
      {"bufferView", view}, {"attributes", {{"POSITION", attribute_id}}}};
  scene.root["extensionsUsed"] = {"KHR_draco_mesh_compression"};
  scene.root["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  return scene;
}

// Corners in the decoder's order, by draco's own entry point.
std::vector<std::vector<float>> decoded_corners(const std::vector<char>& stream) {
  draco::DecoderBuffer buffer;
  buffer.Init(stream.data(), stream.size());
  const auto mesh = draco::Decoder().DecodeMeshFromBuffer(&buffer).value();
  const draco::PointAttribute* positions = mesh->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  std::vector<std::vector<float>> triangles;
  for (draco::FaceIndex face(0); face < mesh->num_faces(); ++face) {
    std::vector<float>& triangle = triangles.emplace_back();
    for (const draco::PointIndex& point : mesh->face(face)) {
      float xyz[3];
      EXPECT_TRUE(positions->ConvertValue(positions->mapped_index(point), 3, xyz));
      triangle.insert(triangle.end(), xyz, xyz + 3);
    }
  }
  return triangles;
}

void expect_decoders_order(const std::vector<char>& stream) {
  const Imported imported = import_bytes(scene_of(stream).text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.triangles, 2U * (kSide - 1) * (kSide - 1));
  EXPECT_EQ(imported.report.counts.at(ImportCode::draco_primitives), 1U);
  const std::vector<std::vector<float>> expected = decoded_corners(stream);
  ASSERT_EQ(imported.triangles.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    ASSERT_EQ(corners(imported.triangles[i]), expected[i]);
    ASSERT_EQ(imported.triangles[i].primitive_id, i);
  }
}

TEST(Draco, Edgebreaker) { expect_decoders_order(encode(draco::MESH_EDGEBREAKER_ENCODING, draco::DT_FLOAT32)); }
TEST(Draco, Sequential) { expect_decoders_order(encode(draco::MESH_SEQUENTIAL_ENCODING, draco::DT_FLOAT32)); }
TEST(Draco, IntegerPositions) { expect_decoders_order(encode(draco::MESH_EDGEBREAKER_ENCODING, draco::DT_INT16)); }
TEST(Draco, WithMetadata) { expect_decoders_order(encode(draco::MESH_EDGEBREAKER_ENCODING, draco::DT_FLOAT32, true)); }

TEST(Draco, StripModeGivesTheSameFaces) {
  const std::vector<char> stream = encode(draco::MESH_EDGEBREAKER_ENCODING, draco::DT_FLOAT32);
  TestScene scene = scene_of(stream);
  scene.root["meshes"][0]["primitives"][0]["mode"] = 5;
  EXPECT_EQ(import_bytes(scene.text()).triangles.size(), 2U * (kSide - 1) * (kSide - 1));
  scene.root["meshes"][0]["primitives"][0]["mode"] = 6;
  EXPECT_EQ(import_bytes(scene.text()).status.code(), ErrorCode::bad_scene);
}

TEST(Draco, UnknownAttributeIdIsRefused) {
  const std::vector<char> stream = encode(draco::MESH_EDGEBREAKER_ENCODING, draco::DT_FLOAT32);
  for (const int id : {0, 6, 8, 2147483647}) {
    const Status status = import_bytes(scene_of(stream, id).text()).status;
    EXPECT_EQ(status.code(), ErrorCode::bad_scene);
    EXPECT_NE(status.message().find("has no attribute " + std::to_string(id)), std::string::npos) << status.message();
  }
  EXPECT_EQ(import_bytes(scene_of(stream, -1).text()).status.code(), ErrorCode::bad_scene);
}

TEST(Draco, ViewPastItsBufferIsRefused) {
  TestScene scene = scene_of(encode(draco::MESH_EDGEBREAKER_ENCODING, draco::DT_FLOAT32));
  scene.root["bufferViews"][0]["byteLength"] = 1 << 20;
  const Status status = import_bytes(scene.text()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("bufferViews[0] takes bytes"), std::string::npos) << status.message();
  scene.root["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["bufferView"] = 5;
  EXPECT_EQ(import_bytes(scene.text()).status.code(), ErrorCode::bad_scene);
}

TEST(Draco, EveryCutOfAStreamIsRefused) {
  constexpr std::size_t kStep = tests::kSanitized ? 97 : 13;
  for (const auto method : {draco::MESH_EDGEBREAKER_ENCODING, draco::MESH_SEQUENTIAL_ENCODING}) {
    const std::vector<char> stream = encode(method, draco::DT_FLOAT32);
    for (std::size_t size = 0; size + 8 < stream.size(); size += size < 128 ? 1 : kStep) {
      const Status status =
          import_bytes(scene_of({stream.begin(), stream.begin() + std::ptrdiff_t(size)}).text()).status;
      ASSERT_FALSE(status.ok()) << size;
      ASSERT_FALSE(status.message().empty());
    }
  }
}

TEST(Draco, FaceCountBeyondTheBudgetIsRefusedBeforeItIsAllocated) {
  const std::vector<char> head = encode(draco::MESH_SEQUENTIAL_ENCODING, draco::DT_FLOAT32);
  // Header of 11 bytes, then varints: faces and points. 0xFFFFFFF faces fill seven bits of four bytes.
  std::vector<char> stream(head.begin(), head.begin() + 11);
  stream.insert(stream.end(), {'\xff', '\xff', '\xff', '\x7f', '\x03', '\0'});
  stream.resize(200);
  const Imported imported = import_bytes(scene_of(stream).text(), {}, mebibytes(64));
  EXPECT_EQ(imported.status.code(), ErrorCode::budget_exceeded) << imported.status.message();
}

TEST(Draco, PointCloudsAndOtherBytesAreRefused) {
  std::vector<char> stream = encode(draco::MESH_SEQUENTIAL_ENCODING, draco::DT_FLOAT32);
  stream[7] = 0;  // encoder type: point cloud
  EXPECT_EQ(import_bytes(scene_of(stream).text()).status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(import_bytes(scene_of(std::vector<char>(500, 'x')).text()).status.code(), ErrorCode::bad_scene);
  stream = encode(draco::MESH_SEQUENTIAL_ENCODING, draco::DT_FLOAT32);
  stream[5] = 9;  // version
  EXPECT_EQ(import_bytes(scene_of(stream).text()).status.code(), ErrorCode::unsupported);
}

}  // namespace
}  // namespace raymill::storage
