#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "storage/import/data_uri.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

TestScene contained_scene() {
  TestScene scene;
  const int positions = scene.positions(vertices(3));
  scene.show(positions, scene.indices(std::vector<std::uint16_t>{0, 1, 2}));
  return scene;
}

class Folder {
 public:
  Folder() : path_(std::filesystem::path(testing::TempDir()) / name()) { std::filesystem::create_directories(path_); }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  std::string write(const std::string& file, const std::string& bytes) const {
    std::filesystem::create_directories((path_ / file).parent_path());
    std::ofstream(path_ / file, std::ios::binary) << bytes;
    return (path_ / file).string();
  }
  [[nodiscard]] std::string operator/(const std::string& file) const { return (path_ / file).string(); }

 private:
  static std::string name() {
    const testing::TestInfo& test = *testing::UnitTest::GetInstance()->current_test_info();
    return std::string("raymill_import_") + test.name() + "_" + std::to_string(::getpid());
  }
  std::filesystem::path path_;
};

std::string buffer_text(const TestScene& scene) {
  return {reinterpret_cast<const char*>(scene.buffer.data()), scene.buffer.size()};
}

TEST(Container, Glb) {
  const Imported imported = import_bytes(contained_scene().glb());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.triangles.size(), 1U);
}

TEST(Container, EveryCutOfAGlbIsRefused) {
  const std::string glb = contained_scene().glb();
  for (std::size_t size = 0; size < glb.size(); ++size) {
    const Status status = import_bytes(glb.substr(0, size)).status;
    ASSERT_EQ(status.code(), ErrorCode::bad_scene) << size;
    ASSERT_FALSE(status.message().empty());
  }
}

TEST(Container, EveryChangedByteOfAGlbIsReadOrRefused) {
  const std::string glb = contained_scene().glb();
  for (std::size_t i = 0; i < glb.size(); ++i) {
    for (const char change : {'\x01', '\x80', '\xff'}) {
      std::string changed = glb;
      changed[i] = static_cast<char>(changed[i] ^ change);
      const Status status = import_bytes(changed, {}, mebibytes(64)).status;
      ASSERT_TRUE(status.ok() || !status.message().empty());
      ASSERT_NE(status.code(), ErrorCode::internal);
    }
  }
}

TEST(Container, BinaryChunkShorterThanItsBuffer) {
  TestScene scene = contained_scene();
  scene.root["buffers"][0]["byteLength"] = 1000;
  const Status status = import_bytes(scene.glb()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("buffers[0]: declares 1000 bytes and the GLB's binary chunk holds 44"),
            std::string::npos)
      << status.message();
}

TEST(Container, BuffersBesideTheFile) {
  const Folder folder;
  TestScene scene = contained_scene();
  scene.root["buffers"][0]["uri"] = "data/the%20points.bin";
  const std::string path = folder.write("scene.gltf", scene.root.dump());
  const Status missing = import_path(path).status;
  EXPECT_EQ(missing.code(), ErrorCode::not_found);
  EXPECT_NE(missing.message().find("buffers[0]: there is no file "), std::string::npos) << missing.message();

  folder.write("data/the points.bin", buffer_text(scene));
  const Imported imported = import_path(path);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.triangles.size(), 1U);
  EXPECT_EQ(imported.report.geometries[0].file, path);

  folder.write("data/the points.bin", buffer_text(scene).substr(0, 40));
  const Status cut = import_path(path).status;
  EXPECT_EQ(cut.code(), ErrorCode::bad_scene);
  EXPECT_NE(cut.message().find("holds 40; the file is damaged or was cut short"), std::string::npos) << cut.message();
}

TEST(Container, BuffersThatNothingReadsMayBeMissing) {
  TestScene scene = contained_scene();
  scene.root["buffers"].push_back({{"byteLength", 100}, {"uri", "animation.bin"}});
  EXPECT_TRUE(import_bytes(scene.text()).status.ok());
}

TEST(Container, UrisThatAreNoFilesBesideTheScene) {
  const Folder folder;
  for (const char* uri : {"http://example.org/a.bin", "file:///etc/passwd", "/etc/passwd"}) {
    TestScene scene = contained_scene();
    scene.root["buffers"][0]["uri"] = uri;
    EXPECT_EQ(import_path(folder.write("scene.gltf", scene.root.dump())).status.code(), ErrorCode::unsupported) << uri;
  }
  TestScene scene = contained_scene();
  scene.root["buffers"][0]["uri"] = "a%00b.bin";
  EXPECT_EQ(import_path(folder.write("scene.gltf", scene.root.dump())).status.code(), ErrorCode::bad_scene);
  scene.root["buffers"][0]["uri"] = "beside.bin";
  EXPECT_EQ(import_bytes(scene.root.dump()).status.code(), ErrorCode::unsupported);
}

TEST(Container, PipesAndFoldersAreNotWaitedFor) {
  const Folder folder;
  ASSERT_EQ(::mkfifo((folder / "pipe.bin").c_str(), 0600), 0);
  TestScene scene = contained_scene();
  scene.root["buffers"][0]["uri"] = "pipe.bin";
  EXPECT_EQ(import_path(folder.write("scene.gltf", scene.root.dump())).status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(import_path(folder / ".").status.code(), ErrorCode::bad_scene);
  EXPECT_EQ(import_path(folder / "absent.gltf").status.code(), ErrorCode::not_found);
}

TEST(Container, BufferWithoutData) {
  TestScene scene = contained_scene();
  EXPECT_EQ(import_bytes(scene.root.dump()).status.code(), ErrorCode::bad_scene);
  scene.root["buffers"][0]["extensions"]["EXT_meshopt_compression"]["fallback"] = true;
  scene.root["extensionsUsed"] = {"EXT_meshopt_compression"};
  const Status status = import_bytes(scene.root.dump()).status;
  EXPECT_EQ(status.code(), ErrorCode::bad_scene);
  EXPECT_NE(status.message().find("EXT_meshopt_compression"), std::string::npos) << status.message();
}

TEST(Container, FallbackBufferOfMeshoptIsReadWhereAViewIsNotCompressed) {
  TestScene scene = contained_scene();
  scene.root["buffers"][0]["extensions"]["EXT_meshopt_compression"]["fallback"] = true;
  scene.root["extensionsUsed"] = {"EXT_meshopt_compression"};
  const Imported imported = import_bytes(scene.text());
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(imported.report.counts.count(ImportCode::meshopt_views), 0U);
}

std::string decoded(const std::string& uri) {
  const auto bytes = decode_data_uri(uri);
  return bytes ? std::string(reinterpret_cast<const char*>(bytes->data()), bytes->size()) : "refused";
}

TEST(DataUri, Base64) {
  EXPECT_EQ(decoded("data:;base64,"), "");
  EXPECT_EQ(decoded("data:application/octet-stream;base64,Zm9vYmFy"), "foobar");
  EXPECT_EQ(decoded("data:application/gltf-buffer;base64,Zm9vYmE="), "fooba");
  EXPECT_EQ(decoded("data:;base64,Zm9vYg=="), "foob");
  EXPECT_EQ(decoded("data:;base64,Zm9vYg"), "foob");
  EXPECT_EQ(decoded("data:;base64,Zm9vY"), "refused");
  EXPECT_EQ(decoded("data:;base64,Zm9v Yg=="), "refused");
  EXPECT_EQ(decoded("data:;base64,Zm=v"), "refused");
  EXPECT_EQ(decoded("data:text/plain,foo"), "refused");
  EXPECT_EQ(decoded("data:;base64"), "refused");
}

TEST(DataUri, Percent) {
  EXPECT_EQ(percent_decode("a%20b%2Fc"), "a b/c");
  EXPECT_EQ(percent_decode("%41"), "A");
  EXPECT_FALSE(percent_decode("a%2"));
  EXPECT_FALSE(percent_decode("%"));
  EXPECT_FALSE(percent_decode("a%zz"));
}

}  // namespace
}  // namespace raymill::storage
