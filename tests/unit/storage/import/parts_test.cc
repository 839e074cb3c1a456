// Parts of a scene that lie apart: where it is cut, and that each mesh comes in the space of its part.
#include <gtest/gtest.h>

#include "storage/import/scene_parts.h"
#include "tests/unit/storage/import/test_scene.h"

namespace raymill::storage {
namespace {

ScenePiece piece(double x, double side, bool gains = true) { return {{{x, 0, 0}, {x + side, side, side}}, gains}; }

std::vector<ScenePiece> copies(std::vector<ScenePiece> pieces, std::size_t count, double step) {
  for (std::size_t i = 1; i < count; ++i) {
    pieces.push_back(piece(pieces[0].box.lower[0] + double(i) * step, pieces[0].box.side()));
  }
  return pieces;
}

TEST(SceneParts, AreCutWhereNothingLies) {
  const auto parts = find_parts({piece(-5e6, 1000), piece(5e6, 1000), piece(0, 10), piece(5e6 + 1200, 800)});
  ASSERT_EQ(parts.size(), 2U) << "the piece about zero needs none";
  EXPECT_EQ(part_of(parts, piece(-5e6, 1000).box), 0U);
  EXPECT_EQ(part_of(parts, piece(5e6, 1000).box), 1U);
  EXPECT_EQ(part_of(parts, piece(5e6 + 1200, 800).box), 1U) << "two hundred units beside it";
  EXPECT_EQ(part_of(parts, piece(0, 10).box), kNoPart);
  EXPECT_EQ(part_of(parts, Extent()), kNoPart);
  EXPECT_NEAR(parts[0].origin.position()[0], -5e6 + 500, 1024);
  EXPECT_NEAR(parts[1].origin.position()[0], 5e6 + 1000, 2048);
}

TEST(SceneParts, AreNoneWhereFloat32WillDo) {
  EXPECT_TRUE(find_parts({}).empty());
  EXPECT_TRUE(find_parts({piece(0, 1), piece(16000, 1)}).empty()) << "a thousandth of a unit is kept there";
  EXPECT_TRUE(find_parts({piece(0, 5e6), piece(5e6, 1)}).empty()) << "they touch";
  EXPECT_TRUE(find_parts({piece(-5e6, 1e6), piece(5e6, 1e6)}).empty()) << "large for where they lie";
  EXPECT_TRUE(find_parts({piece(-5e6, 10, false), piece(5e6, 10, false)}).empty()) << "float32 before";
  EXPECT_TRUE(find_parts({piece(1e200, 1), piece(0, 1)}).empty()) << "beyond what is kept of a scene";
  // A row without gaps, however long.
  EXPECT_TRUE(find_parts(copies({piece(-5e6, 1000)}, 10000, 1000)).empty());
}

TEST(SceneParts, OfManyAreJoinedByWiderGaps) {
  const auto one_row = [](std::size_t count) { return copies({piece(1e6, 1)}, count, 1e6); };
  EXPECT_EQ(find_parts(one_row(100)).size(), 100U);
  EXPECT_LE(find_parts(one_row(250)).size(), kMostParts);
  std::vector<ScenePiece> square;
  for (int i = 0; i < 40; ++i) {
    for (int j = 0; j < 40; ++j) {
      square.push_back({{{i * 1e6, j * 1e6, 0}, {i * 1e6 + 1, j * 1e6 + 1, 1}}, true});
    }
  }
  EXPECT_LE(find_parts(square).size(), kMostParts);
}

class Parts final : public PartSink {
 public:
  void enter_part(std::uint32_t part) override { entered.push_back(part); }
  std::vector<std::uint32_t> entered;
};

TEST(SceneParts, MeshesOfAGltfComeInTheirSpaces) {
  TestScene scene;
  for (const double x : {-5000000.125, 0.0, 5000000.25, 5000000.5}) {
    const int positions = scene.positions({1, 0, 0, 0, 1, 0, 0, 0, 1});
    scene.root["accessors"][std::size_t(positions)]["min"] = {0, 0, 0};
    scene.root["accessors"][std::size_t(positions)]["max"] = {1, 1, 1};
    const int node = scene.show(positions);
    scene.root["nodes"][std::size_t(node)]["translation"] = {x, 0, 0};
  }
  scene.root["accessors"][3]["min"] = "not numbers";  // so nobody knows where the last one is
  const std::vector<ScenePart> parts = find_parts({piece(-5000000.125, 1), piece(0, 1), piece(5000000.25, 1)});
  ASSERT_EQ(parts.size(), 2U);
  Parts sink;
  ImportOptions options;
  options.parts = parts;
  options.part_sink = &sink;
  const Imported imported = import_bytes(scene.text(), options);
  ASSERT_TRUE(imported.status.ok()) << imported.status.message();
  EXPECT_EQ(sink.entered, (std::vector<std::uint32_t>{0, kNoPart, 1, kNoPart}));
  ASSERT_EQ(imported.triangles.size(), 4U);
  for (const std::size_t i : {0, 2}) {
    const double x = i == 0 ? -5000000.125 : 5000000.25;
    const double own = parts[i / 2].origin.position()[0];
    EXPECT_EQ(double(imported.triangles[i].v[0].x), x + 1 - own);
    EXPECT_EQ(imported.triangles[i].geometry_id, i);
  }
  EXPECT_EQ(imported.triangles[3].v[0].x, 5000001.5F);
}

}  // namespace
}  // namespace raymill::storage
