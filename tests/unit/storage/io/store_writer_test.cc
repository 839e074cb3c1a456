// StoreWriter: meshes from the caller's memory.
#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "storage/io/build_store.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"

namespace raymill {
namespace {

using tests::Random;
using tests::Scene;
using tests::TempFolder;

BuildConfig config_of(const TempFolder& folder, const std::string& name = "written.mill") {
  BuildConfig config = tests::small_pages();
  config.output = folder / name;
  return config;
}

std::vector<float> positions_of(const tests::Mesh& mesh) {
  std::vector<float> positions;
  for (const tests::Corners& corners : mesh) {
    for (const auto& p : corners) {
      positions.insert(positions.end(), {p.x, p.y, p.z});
    }
  }
  return positions;
}

StoreWriter make(const BuildConfig& config) {
  auto writer = StoreWriter::create(config);
  EXPECT_TRUE(writer) << writer.status().message();
  return std::move(writer).value();
}

// Header and pages: what stands before the metadata, whose place the footer tells (storage/FORMAT.md).
std::string pages_of(const std::string& path) {
  const std::string bytes = tests::read_file(path);
  constexpr std::size_t kFooterBytes = 184, kMetadataOffset = 8;
  EXPECT_GT(bytes.size(), kFooterBytes);
  std::uint64_t end = 0;
  std::memcpy(&end, bytes.data() + bytes.size() - kFooterBytes + kMetadataOffset, sizeof end);
  return bytes.substr(0, end);
}

void expect_same_hits(const std::string& a, const std::string& b) {
  Random random(9);
  const std::vector<Ray> rays = tests::random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 2000);
  const tests::Traced first = tests::trace(a, rays), second = tests::trace(b, rays);
  ASSERT_TRUE(first.status.ok() && second.status.ok()) << first.status.message() << second.status.message();
  EXPECT_EQ(first.rows == second.rows, true);
  EXPECT_GT(first.stats.hits, 100u);
}

TEST(StoreWriter, GivesThePagesThatABuildOfTheSameMeshesGives) {
  Random random(1);
  const Scene scene{tests::soup(random, 4000), tests::grid(30, 0.1F), tests::coincident(50)};
  for (const std::string positions : {"float32", "lattice:16b"}) {
    const TempFolder folder;
    BuildConfig layout = tests::small_pages();
    layout.positions = positions;
    const std::string built = tests::build_store(folder, "built.mill", scene, layout);
    layout.output = folder / "written.mill";
    StoreWriter writer = make(layout);
    for (const tests::Mesh& mesh : scene) {
      ASSERT_TRUE(writer.add({.name = "part", .positions = positions_of(mesh)}).ok());
    }
    const auto report = writer.finish();
    ASSERT_TRUE(report) << report.status().message();
    EXPECT_EQ(report->triangles, positions == "float32" ? 5850u : report->triangles);
    EXPECT_EQ(pages_of(layout.output) == pages_of(built), true);
    EXPECT_TRUE(verify(layout.output));
    expect_same_hits(layout.output, built);
  }
}

TEST(StoreWriter, IndexedMeshIsTheSameAsItsTrianglesOneByOne) {
  Random random(2);
  const tests::Mesh mesh = tests::soup(random, 1000);
  const std::vector<float> positions = positions_of(mesh);
  // Vertices the other way round, and indices that set them right.
  std::vector<float> reversed;
  std::vector<std::uint32_t> indices;
  const auto vertices = static_cast<std::uint32_t>(positions.size() / 3);
  for (std::uint32_t i = vertices; i-- > 0;) {
    reversed.insert(reversed.end(), positions.begin() + 3 * i, positions.begin() + 3 * i + 3);
    indices.push_back(i);
  }
  const TempFolder folder;
  StoreWriter plain = make(config_of(folder, "plain.mill"));
  ASSERT_TRUE(plain.add({.name = "a", .positions = positions}).ok());
  ASSERT_TRUE(plain.finish());
  StoreWriter indexed = make(config_of(folder, "indexed.mill"));
  ASSERT_TRUE(indexed.add({.name = "a", .positions = reversed, .indices = indices}).ok());
  ASSERT_TRUE(indexed.finish());
  EXPECT_EQ(tests::read_file(folder / "plain.mill") == tests::read_file(folder / "indexed.mill"), true);
}

TEST(StoreWriter, MatrixIsAppliedInFloat64AndRoundedOnce) {
  const TempFolder folder;
  const tests::Mesh mesh = tests::grid(10, 0.3F);
  tests::Mesh expected = mesh;
  for (tests::Corners& corners : expected) {
    for (auto& p : corners) {
      p = {static_cast<float>(0.1 * double(p.x) + 7.3), static_cast<float>(0.1 * double(p.y) - 2.7),
           static_cast<float>(0.1 * double(p.z) + 1e-3)};
    }
  }
  StoreWriter moved = make(config_of(folder, "moved.mill"));
  const std::vector<float> positions = positions_of(mesh);
  ASSERT_TRUE(moved
                  .add({.name = "a",
                        .positions = positions,
                        .world_from_mesh =
                            std::array<double, 16>{0.1, 0, 0, 0, 0, 0.1, 0, 0, 0, 0, 0.1, 0, 7.3, -2.7, 1e-3, 1}})
                  .ok());
  ASSERT_TRUE(moved.finish());
  StoreWriter plain = make(config_of(folder, "plain.mill"));
  const std::vector<float> world = positions_of(expected);
  ASSERT_TRUE(plain.add({.name = "a", .positions = world}).ok());
  ASSERT_TRUE(plain.finish());
  EXPECT_EQ(tests::read_file(folder / "moved.mill") == tests::read_file(folder / "plain.mill"), true);
}

TEST(StoreWriter, PositionsOfFloat64AreRoundedOnceAboutTheOrigin) {
  const TempFolder folder;
  const tests::Mesh mesh = tests::grid(10, 0.3F);
  std::vector<double> wide;
  tests::Mesh expected = mesh;
  for (tests::Corners& corners : expected) {
    for (auto& p : corners) {
      const double world[3] = {1e7 + double(p.x) / 3, -2e6 + double(p.y) / 3, double(p.z) / 3};
      wide.insert(wide.end(), world, world + 3);
      p = {static_cast<float>(world[0] - 1e7), static_cast<float>(world[1] + 2e6), static_cast<float>(world[2])};
    }
  }
  BuildConfig config = config_of(folder, "far.mill");
  config.origin = "10000000,-2000000,0";
  StoreWriter far = make(config);
  ASSERT_TRUE(far.add({.name = "a", .positions64 = wide}).ok());
  const auto report = far.finish();
  ASSERT_TRUE(report);
  EXPECT_EQ(report->origin, (std::array<double, 3>{1e7, -2e6, 0}));
  StoreWriter plain = make(config_of(folder, "plain.mill"));
  const std::vector<float> near = positions_of(expected);
  ASSERT_TRUE(plain.add({.name = "a", .positions = near}).ok());
  ASSERT_TRUE(plain.finish());
  // All but the header, and the checksum of it in the footer, at its start and of its whole.
  const std::string a = tests::read_file(folder / "far.mill"), b = tests::read_file(folder / "plain.mill");
  ASSERT_EQ(a.size(), b.size());
  EXPECT_TRUE(a.substr(64, a.size() - 64 - 184) == b.substr(64, b.size() - 64 - 184));
}

TEST(StoreWriter, CallersFloatModeChangesNothing) {
  const TempFolder folder;
  const std::vector<float> tiny = positions_of(tests::moved(tests::grid(8, 0.2F), {}, 1e-38F));
  const auto write = [&](const char* name) {
    BuildConfig config = config_of(folder, name);
    config.threads = 2;
    StoreWriter writer = make(config);
    EXPECT_TRUE(writer.add({.name = "a", .positions = tiny}).ok());
    EXPECT_TRUE(writer.finish());
    return tests::read_file(folder / name);
  };
  const std::string before = write("before.mill");
#if defined(__x86_64__)
  const unsigned control = __builtin_ia32_stmxcsr();
  __builtin_ia32_ldmxcsr(control | 0x8040 | 0x6000);  // flush to zero, denormals are zero, round towards zero
#endif
  const std::string during = write("during.mill");
#if defined(__x86_64__)
  EXPECT_EQ(__builtin_ia32_stmxcsr() & 0xFFC0U, (control | 0x8040 | 0x6000) & 0xFFC0U) << "the caller's is put back";
  __builtin_ia32_ldmxcsr(control);
#endif
  EXPECT_TRUE(before == during);
}

TEST(StoreWriter, BadMeshIsRefusedWithItsNameAndNothingIsAdded) {
  const TempFolder folder;
  StoreWriter writer = make(config_of(folder));
  const std::vector<float> triangle = positions_of({{tests::Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}});
  const auto refused = [&](const MeshView& mesh, const std::string& why) {
    const Status status = writer.add(mesh);
    EXPECT_EQ(status.code(), ErrorCode::invalid_argument) << why;
    EXPECT_NE(status.message().find("'hull'"), std::string::npos) << status.message();
    EXPECT_NE(status.message().find(why), std::string::npos) << status.message();
  };
  const std::vector<std::uint32_t> beyond{0, 1, 3}, two{0, 1}, most{0, 1, 0xFFFFFFFF};
  refused({.name = "hull", .positions = std::span(triangle).first(8)}, "8 were given");
  refused({.name = "hull", .positions = triangle, .positions64 = std::vector<double>(9)}, "not in both");
  refused({.name = "hull", .positions = std::span(triangle).first(6)}, "2 were given");
  refused({.name = "hull", .positions = triangle, .indices = two}, "2 were given");
  refused({.name = "hull", .positions = triangle, .indices = beyond}, "index 3");
  refused({.name = "hull", .positions = triangle, .indices = most}, "index 4294967295");
  refused({.name = "hull", .positions = {}, .indices = two}, "2 were given");
  ASSERT_TRUE(writer.add({.name = "deck", .positions = triangle}).ok());
  const auto report = writer.finish();
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_EQ(report->triangles, 1u);
  Ray down;
  down.org = {0.25F, 0.25F, 1};
  down.dir = {0, 0, -1};
  const tests::Traced traced = tests::trace(folder / "written.mill", {{down}});
  ASSERT_EQ(traced.hits.size(), 1u);
  EXPECT_EQ(traced.hits[0].geometry_id, 0u) << "refused meshes take no id";
}

TEST(StoreWriter, TrianglesThatNoRayCouldHitAreDroppedAndStillNumbered) {
  const TempFolder folder;
  StoreWriter writer = make(config_of(folder));
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> positions =
      positions_of({{tests::Vec3f{kNan, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                    {tests::Vec3f{0, 0, 0}, {1, 1, 1}, {2, 2, 2}},
                    {tests::Vec3f{std::numeric_limits<float>::infinity(), 0, 0}, {1, 0, 0}, {0, 1, 0}},
                    {tests::Vec3f{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}});
  ASSERT_TRUE(writer.add({.name = "", .positions = {}}).ok()) << "a mesh without triangles is one";
  ASSERT_TRUE(writer.add({.name = "not \xff UTF-8", .positions = positions}).ok());
  const auto report = writer.finish();
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_EQ(report->triangles, 1u);
  EXPECT_NE(report->import_json.find("\"dropped_not_finite\":{\"code\":101,\"count\":2}"), std::string::npos)
      << report->import_json;
  Ray down;
  down.org = {0.25F, 0.25F, 1};
  down.dir = {0, 0, -1};
  const tests::Traced traced = tests::trace(folder / "written.mill", {{down}});
  ASSERT_EQ(traced.hits.size(), 1u);
  EXPECT_EQ(traced.hits[0].geometry_id, 1u);
  EXPECT_EQ(traced.hits[0].primitive_id, 3u);
}

TEST(StoreWriter, NothingToHitIsABadScene) {
  const TempFolder folder;
  StoreWriter writer = make(config_of(folder));
  EXPECT_EQ(writer.finish().status().code(), ErrorCode::bad_scene);
  EXPECT_EQ(folder.files(), 0u);
}

TEST(StoreWriter, DestructionWithoutFinishLeavesNothing) {
  const TempFolder folder;
  const std::vector<float> positions = positions_of(tests::grid(50));
  {
    StoreWriter writer = make(config_of(folder));
    ASSERT_TRUE(writer.add({.name = "a", .positions = positions}).ok());
    EXPECT_FALSE(std::filesystem::exists(folder / "written.mill"));
  }
  EXPECT_EQ(folder.files(), 0u);
  tests::write_file(folder / "written.mill", "old");
  {
    StoreWriter writer = make(config_of(folder));
    ASSERT_TRUE(writer.add({.name = "a", .positions = positions}).ok());
  }
  EXPECT_EQ(folder.files(), 1u);
  EXPECT_EQ(tests::read_file(folder / "written.mill"), "old");
}

TEST(StoreWriter, IsDoneForAfterFinish) {
  const TempFolder folder;
  const std::vector<float> positions = positions_of(tests::grid(5));
  StoreWriter writer = make(config_of(folder));
  ASSERT_TRUE(writer.add({.name = "a", .positions = positions}).ok());
  ASSERT_TRUE(writer.finish());
  EXPECT_EQ(folder.files(), 1u) << "and holds no file any more";
  EXPECT_EQ(writer.add({.name = "b", .positions = positions}).code(), ErrorCode::invalid_argument);
  EXPECT_EQ(writer.finish().status().code(), ErrorCode::invalid_argument);
  EXPECT_EQ(verify(folder / "written.mill")->triangles, 50u);
}

TEST(StoreWriter, StoppedOneIsDoneFor) {
  const TempFolder folder;
  const std::vector<float> positions = positions_of(tests::grid(5));
  BuildConfig config = config_of(folder);
  bool go_on = false;
  config.progress = [&](const char*, double) { return go_on; };
  StoreWriter writer = make(config);
  EXPECT_EQ(writer.add({.name = "a", .positions = positions}).code(), ErrorCode::interrupted);
  go_on = true;
  EXPECT_EQ(writer.add({.name = "a", .positions = positions}).code(), ErrorCode::interrupted);
  EXPECT_EQ(writer.finish().status().code(), ErrorCode::interrupted);
  EXPECT_FALSE(std::filesystem::exists(config.output));
}

TEST(StoreWriter, WorksAfterItWasMoved) {
  const TempFolder folder;
  const std::vector<float> positions = positions_of(tests::grid(5));
  StoreWriter first = make(config_of(folder));
  ASSERT_TRUE(first.add({.name = "a", .positions = positions}).ok());
  StoreWriter second = std::move(first);
  ASSERT_TRUE(second.add({.name = "b", .positions = positions}).ok());
  const auto report = second.finish();
  ASSERT_TRUE(report) << report.status().message();
  EXPECT_EQ(report->triangles, 100u);
}

TEST(StoreWriter, ConfigsThatCannotBeAreRefused) {
  const TempFolder folder;
  const auto code = [&](auto&& change) {
    BuildConfig config = config_of(folder);
    change(config);
    return StoreWriter::create(config).status().code();
  };
  EXPECT_EQ(code([](BuildConfig&) {}), ErrorCode::ok);
  EXPECT_EQ(code([](BuildConfig& c) { c.scenes = {"a.gltf"}; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.scene_index = 0; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.output.clear(); }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.width = 3; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.codec = "rar"; }), ErrorCode::invalid_argument);
  EXPECT_EQ(code([](BuildConfig& c) { c.memory = mebibytes(1); }), ErrorCode::budget_exceeded);
  EXPECT_EQ(code([&](BuildConfig& c) { c.output = folder / "none/out.mill"; }), ErrorCode::not_found);
  EXPECT_EQ(folder.files(), 0u);
}

}  // namespace
}  // namespace raymill
