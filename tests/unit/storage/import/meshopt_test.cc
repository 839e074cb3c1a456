#include <gtest/gtest.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <cmath>

#include "tests/support/effort.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

using nlohmann::json;
using Stream = std::vector<unsigned char>;

constexpr int kAcross = 20;

// A wavy sheet.
std::vector<float> sheet_positions() {
  std::vector<float> xyz;
  for (int i = 0; i < kAcross * kAcross; ++i) {
    xyz.insert(xyz.end(), {float(i % kAcross), float(i / kAcross), float((i * 7) % 5) * 0.37F});
  }
  return xyz;
}

std::vector<unsigned> sheet_indices() {
  std::vector<unsigned> indices;
  for (unsigned y = 0; y + 1 < kAcross; ++y) {
    for (unsigned x = 0; x + 1 < kAcross; ++x) {
      const unsigned a = y * kAcross + x;
      indices.insert(indices.end(), {a, a + 1, a + kAcross, a + 1, a + kAcross + 1, a + kAcross});
    }
  }
  return indices;
}

template <typename T>
Stream encode_vertices(const std::vector<T>& values, std::size_t count) {
  const std::size_t stride = values.size() * sizeof(T) / count;
  Stream stream(meshopt_encodeVertexBufferBound(count, stride));
  stream.resize(meshopt_encodeVertexBuffer(stream.data(), stream.size(), values.data(), count, stride));
  return stream;
}

Stream encode_triangles(const std::vector<unsigned>& indices) {
  Stream stream(meshopt_encodeIndexBufferBound(indices.size(), kAcross * kAcross));
  stream.resize(meshopt_encodeIndexBuffer(stream.data(), stream.size(), indices.data(), indices.size()));
  return stream;
}

Stream encode_sequence(const std::vector<unsigned>& indices) {
  Stream stream(meshopt_encodeIndexSequenceBound(indices.size(), kAcross * kAcross));
  stream.resize(meshopt_encodeIndexSequence(stream.data(), stream.size(), indices.data(), indices.size()));
  return stream;
}

class MeshoptScene : public TestScene {
 public:
  MeshoptScene() {
    root["extensionsUsed"] = root["extensionsRequired"] = {"EXT_meshopt_compression", "KHR_mesh_quantization"};
  }

  // The view that the stream decodes to, in a buffer without data.
  int compressed(const Stream& stream, std::size_t count, int stride, const char* mode, const char* filter = nullptr) {
    const int raw = view(stream);
    json extension = root["bufferViews"][raw];
    extension["byteStride"] = stride;
    extension["count"] = count;
    extension["mode"] = mode;
    if (filter != nullptr) {
      extension["filter"] = filter;
    }
    json decoded = {{"buffer", 1}, {"byteLength", count * stride}};
    if (mode == std::string("ATTRIBUTES")) {
      decoded["byteStride"] = stride;
    }
    decoded["extensions"]["EXT_meshopt_compression"] = std::move(extension);
    root["buffers"][1] = {{"byteLength", 1 << 20}, {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}};
    root["bufferViews"].push_back(std::move(decoded));
    return static_cast<int>(root["bufferViews"].size()) - 1;
  }

  json& extension(int view) { return root["bufferViews"][view]["extensions"]["EXT_meshopt_compression"]; }
};

Imported plain_sheet() {
  TestScene scene;
  scene.show(scene.positions(sheet_positions()), scene.indices(sheet_indices()));
  return import_bytes(scene.text());
}

void expect_same(const Imported& imported, const Imported& expected) {
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  ASSERT_EQ(imported.triangles.size(), expected.triangles.size());
  for (std::size_t i = 0; i < expected.triangles.size(); ++i) {
    // The index coder may turn a triangle's corners round.
    const auto& v = imported.triangles[i].v;
    const auto& w = expected.triangles[i].v;
    const auto first = std::find(v.begin(), v.end(), w[0]) - v.begin();
    ASSERT_LT(first, 3) << i;
    EXPECT_TRUE(v[(first + 1) % 3] == w[1] && v[(first + 2) % 3] == w[2]) << i;
    EXPECT_EQ(imported.triangles[i].primitive_id, i);
  }
}

TEST(Meshopt, AttributesTrianglesAndIndices) {
  const std::vector<float> positions = sheet_positions();
  const std::vector<unsigned> indices = sheet_indices();
  const Imported expected = plain_sheet();
  for (const int index_bytes : {2, 4}) {
    for (const bool list : {true, false}) {
      MeshoptScene scene;
      const int vertices =
          scene.compressed(encode_vertices(positions, kAcross * kAcross), kAcross * kAcross, 12, "ATTRIBUTES");
      const int corners = scene.compressed(list ? encode_triangles(indices) : encode_sequence(indices), indices.size(),
                                           index_bytes, list ? "TRIANGLES" : "INDICES", "NONE");
      scene.show(scene.accessor(vertices, kFloat, "VEC3", kAcross * kAcross),
                 scene.accessor(corners, index_bytes == 2 ? kUnsignedShort : kUnsignedInt, "SCALAR", indices.size()));
      const Imported imported = import_bytes(scene.text());
      expect_same(imported, expected);
      EXPECT_EQ(imported.report.counts.at(ImportCode::meshopt_views), 2U);
      EXPECT_EQ(imported.report.counts.count(ImportCode::extension_ignored), 0U);
      expect_same(import_bytes(scene.glb()), expected);
    }
  }
}

TEST(Meshopt, ManyPrimitivesShareViews) {
  const std::vector<unsigned> indices = sheet_indices();
  MeshoptScene scene;
  const int vertices =
      scene.compressed(encode_vertices(sheet_positions(), kAcross * kAcross), kAcross * kAcross, 12, "ATTRIBUTES");
  const int corners = scene.compressed(encode_triangles(indices), indices.size(), 4, "TRIANGLES");
  const int positions = scene.accessor(vertices, kFloat, "VEC3", kAcross * kAcross);
  for (std::size_t first = 0; first < indices.size(); first += 57) {
    const int part = scene.accessor(corners, kUnsignedInt, "SCALAR", std::min<std::size_t>(57, indices.size() - first));
    scene.root["accessors"][part]["byteOffset"] = first * 4;
    scene.show(positions, part);
  }
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.triangles.size(), indices.size() / 3);
}

// Positions that a filter gives, read as VEC3 of `type`, against what the library decodes.
void expect_filter(const char* name, int stride, int type, const std::vector<unsigned char>& encoded,
                   const std::vector<float>& expected) {
  const std::size_t count = encoded.size() / stride;
  MeshoptScene scene;
  const int positions = scene.accessor(
      scene.compressed(encode_vertices(encoded, count), count, stride, "ATTRIBUTES", name), type, "VEC3", count);
  scene.root["accessors"][positions]["normalized"] = type != kFloat;
  scene.show(positions);
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.triangles, count / 3);
  EXPECT_GT(imported.triangles.size(), count / 4);
  for (const Triangle& triangle : imported.triangles) {
    for (std::size_t k = 0; k < 9; ++k) {
      EXPECT_EQ(corners(triangle)[k], expected[triangle.primitive_id * 9 + k]) << triangle.primitive_id << " " << k;
    }
  }
}

std::vector<float> unit_vectors(std::size_t count) {
  std::vector<float> xyzw;
  for (std::size_t i = 0; i < count; ++i) {
    const double a = 0.7 * double(i), b = 0.3 * double(i);
    xyzw.insert(xyzw.end(),
                {float(std::cos(a) * std::cos(b)), float(std::sin(a) * std::cos(b)), float(std::sin(b)), 0});
  }
  return xyzw;
}

template <typename T>
std::vector<float> normalized_xyz(const std::vector<unsigned char>& bytes, double scale) {
  std::vector<float> xyz;
  for (std::size_t i = 0; i < bytes.size() / sizeof(T); ++i) {
    T value;
    std::memcpy(&value, bytes.data() + i * sizeof(T), sizeof(T));
    if (i % 4 != 3) {
      xyz.push_back(static_cast<float>(std::max(value / scale, -1.0)));
    }
  }
  return xyz;
}

TEST(Meshopt, FilterOctahedral) {
  constexpr std::size_t kCount = 33;
  const std::vector<float> vectors = unit_vectors(kCount);
  std::vector<unsigned char> narrow(kCount * 4), wide(kCount * 8);
  meshopt_encodeFilterOct(narrow.data(), kCount, 4, 8, vectors.data());
  meshopt_encodeFilterOct(wide.data(), kCount, 8, 12, vectors.data());
  std::vector<unsigned char> narrow_out = narrow, wide_out = wide;
  meshopt_decodeFilterOct(narrow_out.data(), kCount, 4);
  meshopt_decodeFilterOct(wide_out.data(), kCount, 8);
  expect_filter("OCTAHEDRAL", 4, kByte, narrow, normalized_xyz<std::int8_t>(narrow_out, 127));
  expect_filter("OCTAHEDRAL", 8, kShort, wide, normalized_xyz<std::int16_t>(wide_out, 32767));
  EXPECT_NEAR(normalized_xyz<std::int16_t>(wide_out, 32767)[3], vectors[4], 2e-3);
}

TEST(Meshopt, FilterQuaternion) {
  constexpr std::size_t kCount = 30;
  const std::vector<float> quaternions = unit_vectors(kCount);
  std::vector<unsigned char> encoded(kCount * 8);
  meshopt_encodeFilterQuat(encoded.data(), kCount, 8, 12, quaternions.data());
  std::vector<unsigned char> out = encoded;
  meshopt_decodeFilterQuat(out.data(), kCount, 8);
  expect_filter("QUATERNION", 8, kShort, encoded, normalized_xyz<std::int16_t>(out, 32767));
}

TEST(Meshopt, FilterExponential) {
  const std::vector<float> positions = sheet_positions();
  std::vector<unsigned char> encoded(positions.size() * 4);
  const std::size_t count = positions.size() / 3;
  meshopt_encodeFilterExp(encoded.data(), count, 12, 24, positions.data());
  std::vector<unsigned char> out = encoded;
  meshopt_decodeFilterExp(out.data(), count, 12);
  std::vector<float> expected(positions.size());
  std::memcpy(expected.data(), out.data(), out.size());
  expected.resize(count / 3 * 9);
  expect_filter("EXPONENTIAL", 12, kFloat, encoded, expected);
  EXPECT_NEAR(expected[5], positions[5], 1e-5);
}

struct SheetScene : MeshoptScene {
  SheetScene() {
    const std::vector<unsigned> indices = sheet_indices();
    vertices = compressed(encode_vertices(sheet_positions(), kAcross * kAcross), kAcross * kAcross, 12, "ATTRIBUTES");
    corners = compressed(encode_triangles(indices), indices.size(), 4, "TRIANGLES");
    show(accessor(vertices, kFloat, "VEC3", kAcross * kAcross),
         accessor(corners, kUnsignedInt, "SCALAR", indices.size()));
  }
  int vertices = 0, corners = 0;
};

void expect_extension_refused(const char* key, json value, const std::string& sentence) {
  SheetScene scene;
  scene.extension(scene.vertices)[key] = std::move(value);
  const Status status = import_bytes(scene.text()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find(sentence), std::string::npos) << status.message();
}

TEST(Meshopt, BrokenExtensions) {
  expect_extension_refused("mode", "ROUND", "mode is 'ROUND', which EXT_meshopt_compression does not know");
  expect_extension_refused("mode", 3, "mode is 3; a string is needed");
  expect_extension_refused("filter", "SHARP", "filter is 'SHARP', which EXT_meshopt_compression does not know");
  expect_extension_refused("filter", "OCTAHEDRAL", "byteStride is 12, which its mode and filter do not allow");
  expect_extension_refused("filter", "QUATERNION", "byteStride is 12, which its mode and filter do not allow");
  for (const int stride : {0, 2, 260, 2147483647}) {
    expect_extension_refused("byteStride", stride, "which its mode and filter do not allow");
  }
  expect_extension_refused("count", 401, "bufferViews[1].byteLength is 4800 and 4812 bytes are compressed in it");
  expect_extension_refused("count", 1099511627776, "count is 1099511627776");
  expect_extension_refused("byteLength", 1 << 20, "is read at bytes");
  expect_extension_refused("byteOffset", 9007199254740992, "is read at bytes");
  expect_extension_refused("buffer", 2, "buffer is 2 and the file has 2 buffers");
  expect_extension_refused("buffer", 1, "holds no data: it stands for what EXT_meshopt_compression gives");
  expect_extension_refused("byteLength", 40, "the meshopt stream does not decode to 400 elements of 12 bytes");
  SheetScene scene;
  scene.extension(scene.corners)["filter"] = "EXPONENTIAL";
  EXPECT_NE(import_bytes(scene.text()).status.message().find("filter is for ATTRIBUTES only"), std::string::npos);
  SheetScene odd;
  odd.extension(odd.corners)["count"] = 2165;
  EXPECT_NE(import_bytes(odd.text()).status.message().find("TRIANGLES come in threes"), std::string::npos);
}

TEST(Meshopt, EveryByteMayBeWrong) {
  const SheetScene good;
  for (std::size_t i = 0; i < good.buffer.size(); i += tests::kSanitized ? 7 : 3) {
    SheetScene scene;
    scene.buffer[i] ^= std::byte{0x5A};
    const Status status = import_bytes(scene.glb()).status;
    EXPECT_TRUE(status.ok() || status.code() == ErrorCode::bad_scene) << i << ": " << status.message();
  }
}

TEST(Meshopt, DecodedBytesAreClaimed) {
  SheetScene scene;
  scene.extension(scene.vertices)["count"] = 100'000'000;
  scene.root["bufferViews"][scene.vertices]["byteLength"] = 1'200'000'000;
  const Status status = import_bytes(scene.text(), {}, mebibytes(64)).status;
  EXPECT_EQ(status.code(), ErrorCode::budget_exceeded);
  EXPECT_NE(status.message().find("a compressed bufferView of 1200000000 bytes must be held in memory"),
            std::string::npos)
      << status.message();
}

TEST(Meshopt, TheLeastMemoryHoldsOneView) {
  const Imported expected = plain_sheet();
  const SheetScene scene;
  const std::string text = scene.text();
  std::uint64_t least = mebibytes(1);
  while (import_bytes(text, {}, least).status.code() == ErrorCode::budget_exceeded) {
    least += 1024;
  }
  expect_same(import_bytes(text, {}, least), expected);
}

}  // namespace
}  // namespace raymill::storage
