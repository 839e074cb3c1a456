#include "client/cli/generate/generate.h"

#include <nlohmann/json.hpp>
#include <set>

#include "tests/unit/client/cli/folder.h"

namespace raymill::client {
namespace {

class GenerateTest : public FolderTest {
 protected:
  // Generates and gives back the .gltf.
  nlohmann::json make(SceneKind kind, std::uint64_t triangles, std::uint64_t seed, const std::string& name) {
    auto scene = SceneWriter::create(path(name), nullptr);
    EXPECT_TRUE(scene) << scene.status().message();
    const Status made = generate(kind, triangles, seed, 3, *scene);
    EXPECT_TRUE(made.ok()) << made.message();
    const Status finished = scene->finish();
    EXPECT_TRUE(finished.ok()) << finished.message();
    EXPECT_EQ(scene->triangles(), triangles);
    return nlohmann::json::parse(read(name));
  }
};

constexpr SceneKind kKinds[] = {SceneKind::terrain, SceneKind::city, SceneKind::forest, SceneKind::mixed};

TEST_F(GenerateTest, CountIsMetExactlyAndEveryIndexIsInside) {
  for (const SceneKind kind : kKinds) {
    for (const std::uint64_t triangles : {1ULL, 2ULL, 7ULL, 1001ULL, 60000ULL}) {
      const auto scene = make(kind, triangles, 3, "scene.gltf");
      std::uint64_t indices = 0;
      for (const auto& mesh : scene["meshes"]) {
        const auto& primitive = mesh["primitives"][0];
        const auto& positions = scene["accessors"][primitive["attributes"]["POSITION"].get<int>()];
        const auto& index = scene["accessors"][primitive["indices"].get<int>()];
        const auto& view = scene["bufferViews"][index["bufferView"].get<int>()];
        const std::string bin = read(scene["buffers"][view["buffer"].get<int>()]["uri"]);
        ASSERT_EQ(bin.size(), scene["buffers"][view["buffer"].get<int>()]["byteLength"]);
        const std::size_t count = index["count"], offset = view["byteOffset"];
        ASSERT_EQ(offset + count * 4, bin.size());
        for (std::size_t i = 0; i < count; ++i) {
          std::uint32_t value = 0;
          std::memcpy(&value, bin.data() + offset + 4 * i, 4);
          ASSERT_LT(value, positions["count"].get<std::uint64_t>());
        }
        indices += count;
      }
      EXPECT_EQ(indices, 3 * triangles);
      EXPECT_FALSE(scene["cameras"].empty());
    }
  }
}

TEST_F(GenerateTest, SameSeedSameBytes) {
  for (const SceneKind kind : kKinds) {
    make(kind, 30000, 3, "a.gltf");
    make(kind, 30000, 3, "b.gltf");
    make(kind, 30000, 4, "c.gltf");
    EXPECT_EQ(read("a-00000.bin"), read("b-00000.bin"));
    EXPECT_NE(read("a-00000.bin"), read("c-00000.bin"));
  }
}

TEST_F(GenerateTest, TilesShareTheirBorders) {
  const auto scene = make(SceneKind::terrain, 600000, 3, "big.gltf");
  ASSERT_GT(scene["meshes"].size(), 2U);
  // Each vertex on a tile's border stands in its neighbour with the same bits: a set of all has no near duplicates.
  std::set<std::pair<float, float>> places;
  std::set<std::tuple<float, float, float>> points;
  for (const auto& mesh : scene["meshes"]) {
    const auto& positions = scene["accessors"][mesh["primitives"][0]["attributes"]["POSITION"].get<int>()];
    const std::string bin =
        read(scene["buffers"][scene["bufferViews"][positions["bufferView"].get<int>()]["buffer"].get<int>()]["uri"]);
    const float low_x = positions["min"][0], high_x = positions["max"][0];
    for (std::size_t i = 0; i < positions["count"].get<std::size_t>(); ++i) {
      float p[3];
      std::memcpy(p, bin.data() + 12 * i, 12);
      if (p[0] == low_x || p[0] == high_x) {
        places.emplace(p[0], p[2]);
        points.emplace(p[0], p[1], p[2]);
      }
    }
  }
  EXPECT_EQ(places.size(), points.size());
}

TEST_F(GenerateTest, NothingIsLeftWhenStopped) {
  {
    auto scene = SceneWriter::create(path("scene.gltf"), [](std::uint64_t) { return false; });
    ASSERT_TRUE(scene);
    EXPECT_EQ(generate(SceneKind::terrain, 2000000, 1, 3, *scene).code(), ErrorCode::interrupted);
  }
  EXPECT_EQ(files(), 0U);
}

TEST_F(GenerateTest, NameMustEndInGltf) {
  EXPECT_EQ(SceneWriter::create(path("scene.glb"), nullptr).status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(SceneWriter::create(".gltf", nullptr).status().code(), ErrorCode::invalid_argument);
}

}  // namespace
}  // namespace raymill::client
