// Kept stores of each feature that a store of format 1 may have beside triangles, with a hash of what rays find in
// them. Nothing in them is of sin or cos, which differ from one C library to the next.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "storage/base/checksum.h"
#include "tests/golden/golden.h"
#include "tests/support/instances.h"
#include "tests/support/masks.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/trees.h"
#include "tests/support/volumes.h"

namespace raymill::tests {
namespace {

// Thousands of kilometres apart, multiples of 2^-20.
constexpr std::array<std::array<double, 3>, 3> kFarPlaces = {
    {{-5000000.71875, 1234.0625, 3.03125}, {0, 0, 0}, {4000000.40625, -77.96875, -4999999.84375}}};
constexpr std::array<std::array<double, 3>, 3> kNearPlaces = {{{-0.5, 0.25, 0}, {0, 0, 0}, {0.25, 0, 0.75}}};

Mesh small_soup(std::uint64_t seed, std::size_t triangles = 24) {
  Random random(seed);
  return snapped({soup(random, triangles, 0.6F)}, -10)[0];
}

// A glTF of one mesh with normals and texture coordinates, placed at each of the places.
std::string placed_gltf(const TempFolder& folder, const std::array<std::array<double, 3>, 3>& places) {
  Random random(11);
  const Mesh mesh = small_soup(10);
  std::string bytes(reinterpret_cast<const char*>(mesh.data()), mesh.size() * sizeof(Corners));
  const std::size_t corners = 3 * mesh.size();
  for (std::size_t i = 0; i < 5 * corners; ++i) {
    const float x = static_cast<float>(random.below(64)) / 32 - 1;
    bytes.append(reinterpret_cast<const char*>(&x), sizeof x);
  }
  std::string views, accessors, nodes;
  std::size_t begin = 0;
  for (const std::size_t width : {3U, 3U, 2U}) {
    const std::string comma = begin == 0 ? "" : ",", number = std::to_string(begin == 0 ? 0 : width == 3 ? 1 : 2);
    views += comma + R"({"buffer":0,"byteOffset":)" + std::to_string(begin) + R"(,"byteLength":)" +
             std::to_string(4 * width * corners) + "}";
    accessors += comma + R"({"bufferView":)" + number + R"(,"componentType":5126,"count":)" + std::to_string(corners) +
                 R"(,"type":"VEC)" + std::to_string(width) + R"(")" +
                 (begin == 0 ? R"(,"min":[-2,-2,-2],"max":[2,2,2]})" : "}");
    begin += 4 * width * corners;
  }
  for (const auto& place : places) {
    char text[128];
    std::snprintf(text, sizeof text, R"(%s{"mesh":0,"translation":[%.17g,%.17g,%.17g]})", nodes.empty() ? "" : ",",
                  place[0], place[1], place[2]);
    nodes += text;
  }
  write_file(folder / "placed.bin", bytes);
  write_file(folder / "placed.gltf",
             R"({"asset":{"version":"2.0"},"buffers":[{"uri":"placed.bin","byteLength":)" +
                 std::to_string(bytes.size()) + R"(}],"bufferViews":[)" + views + R"(],"accessors":[)" + accessors +
                 R"(],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1,"TEXCOORD_0":2}}]}],"nodes":[)" +
                 nodes + R"(],"scenes":[{"nodes":[0,1,2]}]})");
  return folder / "placed.gltf";
}

std::string build_file(const TempFolder& folder, BuildConfig config, std::vector<std::string> scenes) {
  config.scenes = std::move(scenes);
  config.output = folder / "now.mill";
  const auto report = build(config);
  EXPECT_TRUE(report.ok()) << report.status().message();
  return config.output;
}

std::string instances(const TempFolder& folder, BuildConfig config) {
  PlacedScene scene{{small_soup(1, 6)}, {{small_soup(2)}, {small_soup(3, 8), grid(2)}}, {}};
  for (std::uint32_t i = 0; i < 4; ++i) {
    const double s = i % 2 == 0 ? 0.5 : -0.75;  // turned by a right angle, sheared, every other one mirrored
    scene.places.push_back({i % 2, {0, 1, 0, 0, s, 0, 0.25, 0, 0, 0, 0.5, 0, 0.25 * i, -0.5, 0.125 * i, 1}});
  }
  return build_placed(folder, "now.mill", scene, config);
}

std::string masks(const TempFolder& folder, BuildConfig config) {
  Random random(4);
  MaskedScene scene;
  for (const std::uint32_t bits : {1U, 8U, 16U}) {
    storage::AlphaMap& map = scene.maps.emplace_back();
    map.info.width = 9;
    map.info.height = 7;
    map.info.bits = static_cast<std::uint8_t>(bits);
    map.info.wrap_s = static_cast<storage::Wrap>(bits % 3);
    map.info.factor = bits == 1 ? 1 : 0.875;
    map.info.cutoff = 0.5;
    map.row_bytes = storage::AlphaMap::bytes_of_row(map.info.width, bits);
    map.texels.resize(map.row_bytes * map.info.height);
    for (std::byte& texels : map.texels) {
      texels = static_cast<std::byte>(random.below(256));
    }
    MaskedScene::Geometry& geometry = scene.geometries.emplace_back();
    geometry.mesh = small_soup(bits, 16);
    geometry.sides = bits == 8 ? storage::Sides::clockwise : storage::Sides::both;
    for (std::size_t i = 0; i < geometry.mesh.size(); ++i) {
      storage::FaceMask& face = geometry.faces.emplace_back();
      face.mask = static_cast<std::uint32_t>(scene.maps.size()) - 1;
      for (auto& corner : face.corners) {
        corner = {static_cast<float>(random.below(64)) / 32, static_cast<float>(random.below(64)) / 32};
      }
    }
  }
  return build_masked(folder, "now.mill", scene, config);
}

std::string volumes(const TempFolder& folder, BuildConfig config) {
  TestVolume fog = wavy_fog(10), surface = ball(12, {0.5, 0.5, 0.5}, 0.375);
  fog.grid.origin = {0, 0, 0};
  fog.grid.world_from_index = {{{0.125, 0, 0, -0.75}, {0, 0.125, 0, -0.5}, {0.0625, 0, 0.125, -1}}};
  fog.value = [](int x, int y, int z) {
    const bool inside = x > 0 && y > 0 && z > 0 && x < 10 && y < 10 && z < 10;
    return inside ? static_cast<float>((x * 3 + y * 5 + z * 7) % 8) / 4 : 0.0F;
  };
  return build_file(folder, config,
                    {write_volume_file(folder, "fog.vdb", fog), write_volume_file(folder, "ball.vdb", surface)});
}

std::string proxies(const TempFolder& folder, BuildConfig config) {
  config.proxies = true;
  config.positions = "lattice:0.03125";
  return build_store(folder, "now.mill", snapped({grid(40)}, -5), config);
}

std::string origin(const TempFolder& folder, BuildConfig config) {
  config.origin = "1000000.5,-2000000.25,3";
  const Mesh far = moved(small_soup(5), {1000000, -2000000, 3});
  return build_store(folder, "now.mill", {far}, config);
}

std::string attributes(const TempFolder& folder, BuildConfig config) {
  config.attributes = "normal,uv0";
  config.instances = "always";
  return build_file(folder, config, {placed_gltf(folder, kNearPlaces)});
}

std::string origins(const TempFolder& folder, BuildConfig config) {
  config.instances = "never";
  return build_file(folder, config, {placed_gltf(folder, kFarPlaces)});
}

struct Feature {
  const char* name;
  std::uint64_t bits;  // of the header's features that the store is kept for
  std::string (*build)(const TempFolder&, BuildConfig);
  Query query = Query::closest;
  bool far = false;  // rays of float64 at each of the far places
  double tolerance = 0;
};

const Feature kFeatures[] = {
    {"instances", 8, instances},
    {"masks", 16, masks},
    {"volumes", 32, volumes},
    {"fog", 32, volumes, Query::transmittance},
    {"proxies", 128, proxies, Query::closest, false, 0.5},
    {"origin", 256, origin},
    {"attributes", 512 + 8, attributes},
    {"origins", 1024 + 8, origins, Query::closest, true},
};

std::string kept_path(const Feature& feature) {
  return kGolden + "format_1_" + (feature.query == Query::transmittance ? "volumes" : feature.name) + ".mill";
}

// Rows as they stand in a hits file, every NaN the same.
std::string hash_of_rows(std::string rows) {
  for (std::size_t i = 0; i + 4 <= rows.size(); i += 4) {
    std::uint32_t word = 0;
    std::memcpy(&word, rows.data() + i, 4);
    word = (word & 0x7FFFFFFFU) > 0x7F800000U ? 0x7FC00000U : word;
    std::memcpy(rows.data() + i, &word, 4);
  }
  char hash[32];
  std::snprintf(hash, sizeof hash, "%016llx\n",
                static_cast<unsigned long long>(storage::checksum(std::as_bytes(std::span(rows)))));
  return hash;
}

struct Answers {
  std::string hash;
  std::uint64_t hits = 0;  // rays that hit, or that fog weakens
};

Result<Answers> answers_of(const Feature& feature, const std::string& path, const std::string& isa) {
  Random random(6);
  const std::vector<Ray> rays = random_rays(random, {{-1, -1, -1}, {1, 1, 1}}, 1000);
  RAYMILL_ASSIGN_OR_RETURN(const auto engine, Engine::create({.memory = gibibytes(8), .threads = 1, .isa = isa}));
  RAYMILL_ASSIGN_OR_RETURN(const auto store, engine->open(path));
  TraceConfig config{.query = feature.query, .relative = !feature.far};
  config.fields = feature.query == Query::transmittance ? answered_fields(feature.query, Field::t) : Field::all;
  config.fields = feature.bits >= 512 && !feature.far ? Field::all | Field::shading_normal | Field::uv0 : config.fields;
  config.float64 = feature.far;
  config.tolerance = feature.tolerance;
  RAYMILL_ASSIGN_OR_RETURN(const auto job, store->trace(config));
  for (const auto& place : feature.far ? std::span(kFarPlaces) : std::span(kFarPlaces).first(1)) {
    if (!feature.far) {
      RAYMILL_RETURN_IF_ERROR(job->push(rays));
      continue;
    }
    std::vector<Ray64> there;
    for (const Ray& ray : rays) {
      Ray64& wide = there.emplace_back();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        wide.org[axis] = double(ray.org[axis]) + place[axis];
        wide.dir[axis] = ray.dir[axis];
      }
      wide.tnear = ray.tnear;
      wide.tfar = ray.tfar;
    }
    RAYMILL_RETURN_IF_ERROR(job->push64(there));
  }
  RAYMILL_RETURN_IF_ERROR(job->finish());
  std::string rows;
  while (const auto chunk = job->next()) {
    rows.append(reinterpret_cast<const char*>(chunk->rows().data()), chunk->rows().size());
  }
  RAYMILL_RETURN_IF_ERROR(job->status());
  std::uint64_t hits = job->stats().hits;
  for (std::size_t i = 0; feature.query == Query::transmittance && i < rows.size(); i += sizeof(float)) {
    float passes = 1;
    std::memcpy(&passes, rows.data() + i, sizeof passes);
    hits += passes < 1 ? 1 : 0;
  }
  return Answers{hash_of_rows(std::move(rows)), hits};
}

class OldFeature : public testing::TestWithParam<Feature> {};

TEST_P(OldFeature, IsReadAndGivesItsHits) {
  const Feature& feature = GetParam();
  const std::string path = kept_path(feature), hits = kGolden + "format_1_" + feature.name + ".hits";
  const TempFolder folder;
  if (rewrite() && !std::filesystem::exists(path)) {
    write_file(path, read_file(feature.build(folder, small_pages())));
  }
  if (rewrite() && !std::filesystem::exists(hits)) {
    const auto answers = answers_of(feature, path, "");
    ASSERT_TRUE(answers.ok()) << answers.status().message();
    write_file(hits, answers->hash);
  }
  EXPECT_LT(std::filesystem::file_size(path), 8192U);
  std::uint64_t features = 0;
  std::memcpy(&features, read_file(path).data() + 16, sizeof features);
  EXPECT_EQ(features & feature.bits, feature.bits);
  const auto verified = verify(path);
  ASSERT_TRUE(verified) << verified.status().message();
  for (const std::string& isa : available_isas()) {
    const auto answers = answers_of(feature, path, isa);
    ASSERT_TRUE(answers.ok()) << answers.status().message();
    EXPECT_GT(answers->hits, 50U);
    EXPECT_EQ(answers->hash, read_file(hits)) << isa;
  }
}

// Whatever was kept, the same scene gives the same hits today.
TEST_P(OldFeature, AndAStoreOfTodayGiveTheSameHits) {
  const Feature& feature = GetParam();
  const TempFolder folder;
  const auto answers = answers_of(feature, feature.build(folder, small_pages()), "");
  ASSERT_TRUE(answers.ok()) << answers.status().message();
  EXPECT_EQ(answers->hash, read_file(kGolden + "format_1_" + feature.name + ".hits"));
}

INSTANTIATE_TEST_SUITE_P(Kept, OldFeature, testing::ValuesIn(kFeatures),
                         [](const auto& param) { return std::string(param.param.name); });

}  // namespace
}  // namespace raymill::tests
