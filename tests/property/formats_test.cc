// What a scene was written as is nothing that a ray could tell: the same meshes as glTF, PLY, OBJ and STL give stores
// with the same hits, byte for byte.
#include <gtest/gtest.h>

#include <fstream>

#include "tests/support/mesh_files.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill::tests {
namespace {

class Formats : public testing::Test {
 protected:
  Formats() : random_(42) {
    scene_ = {soup(random_, 800), sphere({0.5F, 0, 0}, 0.7F, 12, 20), grid(12, 0.4F)};
    rays_ = mixed_rays(random_, scene_, 4000);
    expected_ = rows_of("gltf", {{"scene.glb", glb(scene_)}});
  }

  struct File {
    std::string name;
    std::string bytes;
  };

  std::string rows_of(const std::string& name, const std::vector<File>& files) {
    BuildConfig config = small_pages();
    config.output = folder_ / (name + ".mill");
    for (const File& file : files) {
      config.scenes.push_back(folder_ / file.name);
      std::ofstream(config.scenes.back(), std::ios::binary) << file.bytes;
    }
    const auto report = build(config);
    EXPECT_TRUE(report.ok()) << report.status().message();
    const Traced traced = trace(config.output, rays_);
    EXPECT_TRUE(traced.status.ok()) << traced.status.message();
    return traced.rows;
  }

  TempFolder folder_;
  Random random_;
  Scene scene_;
  std::vector<Ray> rays_;
  std::string expected_;
};

TEST_F(Formats, GiveTheSameHits) {
  EXPECT_FALSE(expected_.empty());
  EXPECT_TRUE(rows_of("obj", {{"a.obj", obj(scene_, false)}}) == expected_);
  EXPECT_TRUE(rows_of("negative", {{"b.obj", obj(scene_, true)}}) == expected_);
  EXPECT_TRUE(rows_of("words", {{"c.stl", stl_text(scene_)}}) == expected_);
  // One mesh a file: geometry ids number on.
  std::vector<File> solids;
  for (const Mesh& mesh : scene_) {
    solids.push_back({"solid" + std::to_string(solids.size()) + ".stl", stl_binary(mesh)});
  }
  EXPECT_TRUE(rows_of("binary", solids) == expected_);
  for (const PlyKind kind : {PlyKind::text, PlyKind::little_endian, PlyKind::big_endian}) {
    std::vector<File> meshes;
    for (const Mesh& mesh : scene_) {
      meshes.push_back({"mesh" + std::to_string(meshes.size()) + ".ply", ply(mesh, kind)});
    }
    EXPECT_TRUE(rows_of("ply" + std::to_string(int(kind)), meshes) == expected_);
  }
  // And all of them in one scene.
  EXPECT_TRUE(rows_of("mixed", {{"m.ply", ply(scene_[0], PlyKind::big_endian)},
                                {"m.obj", obj({scene_[1]}, false)},
                                {"m.stl", stl_binary(scene_[2])}}) == expected_);
}

}  // namespace
}  // namespace raymill::tests
