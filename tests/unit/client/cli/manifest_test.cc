#include "client/cli/manifest.h"

#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

class ManifestTest : public FolderTest {
 protected:
  void expect_refused(const std::string& text, ErrorCode code, const std::string& reason) {
    write("list.txt", text);
    const auto scenes = read_manifest(path("list.txt"));
    ASSERT_FALSE(scenes);
    EXPECT_EQ(scenes.status().code(), code);
    EXPECT_EQ(exit_code(code), 42);
    EXPECT_NE(scenes.status().message().find("list.txt"), std::string::npos) << scenes.status().message();
    EXPECT_NE(scenes.status().message().find(reason), std::string::npos) << scenes.status().message();
  }
};

TEST_F(ManifestTest, NamesAreRelativeToTheManifestsFolderAndKeepTheirOrder) {
  std::filesystem::create_directory(folder_ / "tiles");
  for (const char* name : {"tiles/b.glb", "tiles/a.gltf", "top.glb", "with space.glb"}) {
    write(name, "");
  }
  write("list.txt",
        "# tiles\n\ntiles/b.glb\n" + path("top.glb") + "\r\n  \n#tiles/none.glb\nwith space.glb\ntiles/a.gltf");
  const auto scenes = read_manifest(path("list.txt"));
  ASSERT_TRUE(scenes) << scenes.status().message();
  EXPECT_EQ(*scenes, (std::vector<std::string>{path("tiles/b.glb"), path("top.glb"), path("with space.glb"),
                                               path("tiles/a.gltf")}));
}

TEST_F(ManifestTest, OneWithoutAFolderMeansTheCurrentOne) {
  write("a.glb", "");
  write("list.txt", "a.glb\n");
  const auto before = std::filesystem::current_path();
  std::filesystem::current_path(folder_);
  const auto scenes = read_manifest("list.txt");
  std::filesystem::current_path(before);
  ASSERT_TRUE(scenes) << scenes.status().message();
  EXPECT_EQ(*scenes, std::vector<std::string>{"a.glb"});
}

TEST_F(ManifestTest, ListsThousands) {
  write("a.glb", "");
  std::string text;
  for (int i = 0; i < 5000; ++i) {
    text += "a.glb\n";
  }
  write("list.txt", text);
  EXPECT_EQ(read_manifest(path("list.txt"))->size(), 5000u);
}

TEST_F(ManifestTest, OneThatIsNotThereIsNotFound) {
  EXPECT_EQ(read_manifest(path("none.txt")).status().code(), ErrorCode::not_found);
  EXPECT_EQ(read_manifest(path("none/list.txt")).status().code(), ErrorCode::not_found);
}

TEST_F(ManifestTest, MissingSceneIsNamedWithItsLine) {
  write("a.glb", "");
  expect_refused("a.glb\n\nnone.glb\n", ErrorCode::not_found, "line 3: " + path("none.glb"));
  expect_refused("a.glb\na.glb/b.glb\n", ErrorCode::not_found, "line 2");
}

TEST_F(ManifestTest, WhatIsNoListIsABadScene) {
  write("a.glb", "");
  expect_refused("", ErrorCode::bad_scene, "lists no scene");
  expect_refused("# nothing\n\n", ErrorCode::bad_scene, "lists no scene");
  expect_refused("a.glb\n.\n", ErrorCode::bad_scene, "line 2");
  expect_refused("a.glb\na" + std::string(1, '\0') + "b\n", ErrorCode::bad_scene, "line 2: holds a zero byte");
  expect_refused(std::string(1 << 20, 'x'), ErrorCode::bad_scene, "a line is longer than 4096 bytes");
  EXPECT_EQ(read_manifest(folder_).status().code(), ErrorCode::bad_scene) << "a folder";
}

}  // namespace
}  // namespace raymill::client
