// The server with the real engine: the same bytes as the engine embedded in the caller's process.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <random>

#include "client/cpp/raymill.h"
#include "server/limits.h"
#include "tests/unit/server/harness.h"

namespace raymill::server {
namespace {

constexpr int kGridSide = 120;
constexpr std::size_t kRays = 150'000;

/// A wavy grid as glTF with a binary file beside it.
void write_grid(const std::filesystem::path& folder) {
  std::vector<float> positions;
  for (int y = 0; y <= kGridSide; ++y) {
    for (int x = 0; x <= kGridSide; ++x) {
      const auto u = static_cast<float>(x);
      const auto v = static_cast<float>(y);
      positions.insert(positions.end(), {u, std::sin(u * 0.3f) * std::cos(v * 0.2f), v});
    }
  }
  std::vector<std::uint32_t> indices;
  for (std::uint32_t y = 0; y < kGridSide; ++y) {
    for (std::uint32_t x = 0; x < kGridSide; ++x) {
      const std::uint32_t corner = y * (kGridSide + 1) + x;
      indices.insert(indices.end(), {corner, corner + 1, corner + kGridSide + 1, corner + 1, corner + kGridSide + 2,
                                     corner + kGridSide + 1});
    }
  }
  const std::size_t position_bytes = positions.size() * sizeof(float);
  const std::size_t index_bytes = indices.size() * sizeof(std::uint32_t);
  std::ofstream bin(folder / "grid.bin", std::ios::binary);
  bin.write(reinterpret_cast<const char*>(positions.data()), static_cast<std::streamsize>(position_bytes));
  bin.write(reinterpret_cast<const char*>(indices.data()), static_cast<std::streamsize>(index_bytes));
  std::ofstream(folder / "grid.gltf")
      << R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
      << R"("meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],)"
      << R"("buffers":[{"uri":"grid.bin","byteLength":)" << position_bytes + index_bytes << "}],"
      << R"("bufferViews":[{"buffer":0,"byteLength":)" << position_bytes << R"(},{"buffer":0,"byteOffset":)"
      << position_bytes << R"(,"byteLength":)" << index_bytes << "}],"
      << R"("accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":)" << positions.size() / 3
      << R"(,"min":[0,-1,0],"max":[120,1,120]},{"bufferView":1,"componentType":5125,"type":"SCALAR","count":)"
      << indices.size() << "}]}";
}

std::vector<Ray> random_rays() {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> place(-10, kGridSide + 10);
  std::uniform_real_distribution<float> slope(-1, 1);
  std::vector<Ray> rays(kRays);
  for (Ray& ray : rays) {
    ray.org = {place(random), 3, place(random)};
    ray.dir = {slope(random), -1, slope(random)};
  }
  rays[17].dir = {0, 0, 0};  // invalid ones travel too
  return rays;
}

/// The same with more digits than float32 holds.
std::vector<Ray64> wide_rays(std::span<const Ray> rays) {
  std::vector<Ray64> wide;
  for (const Ray& ray : rays) {
    wide.push_back({.org = {ray.org[0] + 1e-9, ray.org[1] - 1e-8, ray.org[2] + 3e-8},
                    .tnear = ray.tnear,
                    .dir = {ray.dir[0], ray.dir[1], ray.dir[2]},
                    .tfar = ray.tfar});
  }
  return wide;
}

/// What ray i brings: the ids of some triangle, a mask of one of four bits.
struct Brought {
  std::vector<PrimitiveIds> skipped;
  std::vector<std::uint32_t> masks;

  explicit Brought(const TraceConfig& config) {
    for (std::uint32_t i = 0; i < kRays; ++i) {
      if (config.skips) {
        skipped.push_back({0, i % (2 * kGridSide * kGridSide)});
      }
      if (config.masks) {
        masks.push_back(1u << i % 4);
      }
    }
  }
};

/// Where lists of rays end, whatever pieces they come in; and their rows.
class Answers {
 public:
  void add(const HitChunk& chunk) {
    const auto offsets = chunk.offsets();
    for (std::size_t i = 1; i + (chunk.goes_on() ? 1 : 0) < offsets.size(); ++i) {
      ends_.push_back(rows_.size() / chunk.layout().row_bytes() + offsets[i]);
    }
    rows_.insert(rows_.end(), chunk.rows().begin(), chunk.rows().end());
  }
  [[nodiscard]] const std::vector<std::uint64_t>& ends() const { return ends_; }
  [[nodiscard]] std::size_t bytes() const { return rows_.size(); }
  bool operator==(const Answers&) const = default;

 private:
  std::vector<std::uint64_t> ends_;
  std::vector<std::byte> rows_;
};

/// All answers of a job that is pushed whole, in uneven pieces, before the first is read.
Answers trace(Service& service, const std::string& store_name, const TraceConfig& config) {
  Answers bytes;
  auto store = service.open(store_name);
  if (!store.ok()) {
    ADD_FAILURE() << store.status().message();
    return bytes;
  }
  auto job = (*store)->trace(config);
  if (!job.ok()) {
    ADD_FAILURE() << job.status().message();
    return bytes;
  }
  const std::vector<Ray> rays = random_rays();
  const Brought brought(config);
  for (std::size_t at = 0, count = 0; at < rays.size(); at += count) {
    count = std::min(rays.size() - at, at % 7919 + 4000);
    RayExtras extras;
    extras.skipped = brought.skipped.empty() ? extras.skipped : std::span(brought.skipped).subspan(at, count);
    extras.masks = brought.masks.empty() ? extras.masks : std::span(brought.masks).subspan(at, count);
    const auto some = std::span(rays).subspan(at, count);
    // Of a job for float64 some rays are float32 all the same.
    const Status status = config.float64 && at % 3 != 1  ? (*job)->push64(wide_rays(some), extras)
                          : config.skips || config.masks ? (*job)->push_with(some, extras)
                                                         : (*job)->push(some);
    EXPECT_TRUE(status.ok()) << status.message();
  }
  EXPECT_TRUE((*job)->finish().ok());
  while (const auto chunk = (*job)->next()) {
    bytes.add(*chunk);
  }
  EXPECT_TRUE((*job)->status().ok()) << (*job)->status().message();
  const JobStats stats = (*job)->stats();
  EXPECT_EQ(stats.rays, kRays);
  EXPECT_EQ(stats.invalid, 1u);
  EXPECT_FALSE(stats.kernel.empty());
  return bytes;
}

TEST(ServerEngine, GivesTheBytesOfTheEmbeddedEngine) {
  const TemporaryFolder folder;
  write_grid(folder.path());
  std::filesystem::create_directory(folder.path() / "stores");
  BuildConfig build_config;
  build_config.scenes = {(folder.path() / "grid.gltf").string()};
  build_config.output = (folder.path() / "stores/grid.mill").string();
  const auto report = build(build_config);
  ASSERT_TRUE(report.ok()) << report.status().message();
  ASSERT_EQ(report->triangles, 2u * kGridSide * kGridSide);
  BuildConfig wide_config = build_config;
  wide_config.output = (folder.path() / "stores/wide.mill").string();
  wide_config.instances = wide_config.origins = "always";
  ASSERT_TRUE(build(wide_config).ok());

  ServeConfig config;
  config.stores_directory = (folder.path() / "stores").string();
  config.spool_directory = folder.path().string();
  config.bind = "ipc://" + (folder.path() / "socket").string();
  config.memory = gibibytes(1);
  auto server = Server::start(config);
  ASSERT_TRUE(server.ok()) << server.status().message();
  std::thread thread([&] { EXPECT_TRUE((*server)->run().ok()); });
  EngineConfig engine_config;
  engine_config.memory = gibibytes(1);
  auto engine = Engine::create(engine_config);
  ASSERT_TRUE(engine.ok()) << engine.status().message();
  auto client = Client::connect({.address = config.bind});
  ASSERT_TRUE(client.ok()) << client.status().message();
  const auto masks = std::make_shared<const std::vector<std::uint32_t>>(std::vector<std::uint32_t>{5});
  for (const TraceConfig& request :
       {TraceConfig{}, TraceConfig{.mode = Mode::fast, .fields = Field::all}, TraceConfig{.query = Query::any},
        TraceConfig{.query = Query::count}, TraceConfig{.query = Query::all},
        TraceConfig{.query = Query::all, .fields = Field::all, .first = 1},
        TraceConfig{.query = Query::count, .skips = true},
        TraceConfig{.query = Query::all, .skips = true, .masks = true, .geometry_masks = masks},
        TraceConfig{.masks = true, .mask = 3, .geometry_masks = masks}, TraceConfig{.float64 = true},
        TraceConfig{.query = Query::count, .skips = true, .masks = true, .float64 = true, .geometry_masks = masks}}) {
    const std::string& path = request.float64 ? wide_config.output : build_config.output;
    const Answers embedded = trace(**engine, path, request);
    const Answers remote = trace(**client, request.float64 ? "wide" : "grid", request);
    EXPECT_EQ(embedded.bytes(), remote.bytes());
    EXPECT_EQ(embedded.ends().size(), gives_lists(request.query) ? kRays : 0);
    EXPECT_GT(embedded.bytes(), 0u);
    EXPECT_TRUE(embedded == remote);
  }
  {
    const auto wide = (*client)->open("wide");
    ASSERT_TRUE(wide.ok());
    const auto keeps = (*wide)->keeps_float64();
    ASSERT_TRUE(keeps.ok()) << keeps.status().message();
    EXPECT_TRUE(*keeps);
  }
  const auto store = (*client)->open("grid");
  ASSERT_TRUE(store.ok());
  const TraceConfig too_many{.geometry_masks =
                                 std::make_shared<const std::vector<std::uint32_t>>(kMostGeometryMasks + 1)};
  EXPECT_EQ((*store)->trace(too_many).status().code(), ErrorCode::unsupported);
  const auto lists =
      (*client)->submit("grid", {.query = Query::all}, [](std::span<Ray>) { return Result<std::size_t>(0); });
  EXPECT_EQ(lists.status().code(), ErrorCode::unsupported);
  const auto fog = (*store)->trace({.query = Query::transmittance});
  ASSERT_TRUE(fog.ok());
  EXPECT_FALSE((*fog)->next());
  EXPECT_EQ((*fog)->status().code(), ErrorCode::invalid_argument) << "there is none in this store";
  const auto job = (*store)->trace({});
  ASSERT_TRUE(job.ok());
  const Ray ray;
  const PrimitiveIds nothing;
  EXPECT_EQ((*job)->push_with({&ray, 1}, {.skipped = {&nothing, 1}}).code(), ErrorCode::invalid_argument);
  const Ray64 wide_ray;
  EXPECT_EQ((*job)->push64({&wide_ray, 1}).code(), ErrorCode::invalid_argument) << "it was not asked for them";
  const auto keeps = (*store)->keeps_float64();
  ASSERT_TRUE(keeps.ok()) << keeps.status().message();
  EXPECT_FALSE(*keeps);
  const auto info = (*store)->info();
  ASSERT_TRUE(info.ok()) << info.status().message();
  EXPECT_EQ(info->triangles, report->triangles);
  EXPECT_NE(info->metadata_json.find("geometries"), std::string::npos);
  (*server)->stop();
  thread.join();
}

}  // namespace
}  // namespace raymill::server
