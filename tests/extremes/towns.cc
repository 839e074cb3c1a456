#include "tests/extremes/towns.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <sstream>
#include <vector>

#include "tests/extremes/relief.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "traversal/engine.h"

namespace raymill::extremes {
namespace {

// The outer two 10 000 km apart, and no multiples of anything.
constexpr std::array<Point, 3> kPlaces = {{{-2886753.1415926, 2886749.7182818, -2886751.4142135},
                                           {3.7231839, -2.0194531, 1.2718281},
                                           {2886748.5772156, -2886752.6180339, 2886750.6931471}}};
constexpr std::array<const char*, 3> kNames = {"the first", "the middle", "the last"};
constexpr std::array<double, 2> kDistances = {1, 1000};

constexpr const char* kTownsHead = R"(
# Three of them, 10 000 km from the first to the last

Such reliefs as three nodes of one glTF, their corners in float32 about places that float64 holds, 10 000 km from the first
to the last, one in the middle, and rays from as far above each as before. No origin serves all three: `--origins auto`
keeps what lies apart as parts with origins of their own (storage/import/scene_parts.h), and float64 rays bring what float32
leaves of their org to each of them. So the bound is the same. With `--origins never` the outer two have lost their triangles.
Rays that begin further from a part are off by more, as t itself is: half a metre in float32 where a ray comes 10 000 km.

All hits are the same bits from trees of 4 and of 8 children, from every instruction set of the machine, one thread and three,
the least memory, and where each ray is suspended at each node.

| relief | from, who | wrong hits | wrong triangles | t off, median | t off, most | point off, most | off the surface, most |
|---|---|---|---|---|---|---|---|
)";

// Numbers of float64 come back as they were.
std::string number(double x) {
  char text[32];
  std::snprintf(text, sizeof text, "%.17g", x);
  return text;
}

std::string corner_list(const std::array<float, 3>& p) {
  return "[" + number(double(p[0])) + "," + number(double(p[1])) + "," + number(double(p[2])) + "]";
}

// Writes towns.gltf and towns.bin; gives the former's path.
std::string write_scene(const tests::TempFolder& folder, std::span<const Relief> reliefs) {
  std::string bytes, views, accessors, meshes, nodes, list;
  for (std::size_t i = 0; i < reliefs.size(); ++i) {
    const Relief& relief = reliefs[i];
    const std::size_t begin = bytes.size();
    bytes.append(reinterpret_cast<const char*>(relief.local.data()), relief.local.size() * sizeof(float));
    const std::size_t middle = bytes.size();
    bytes.append(reinterpret_cast<const char*>(relief.indices.data()), relief.indices.size() * sizeof(std::uint32_t));
    std::array<float, 3> least{1, 1, 1}, most{0, 0, 0};
    for (std::size_t k = 0; k < relief.local.size(); ++k) {
      least[k % 3] = std::min(least[k % 3], relief.local[k]);
      most[k % 3] = std::max(most[k % 3], relief.local[k]);
    }
    const std::string comma = i == 0 ? "" : ",", position = std::to_string(2 * i), index = std::to_string(2 * i + 1);
    views += comma + R"({"buffer":0,"byteOffset":)" + std::to_string(begin) + R"(,"byteLength":)" +
             std::to_string(middle - begin) + R"(},{"buffer":0,"byteOffset":)" + std::to_string(middle) +
             R"(,"byteLength":)" + std::to_string(bytes.size() - middle) + "}";
    accessors += comma + R"({"bufferView":)" + position + R"(,"componentType":5126,"count":)" +
                 std::to_string(relief.local.size() / 3) + R"(,"type":"VEC3","min":)" + corner_list(least) +
                 R"(,"max":)" + corner_list(most) + R"(},{"bufferView":)" + index +
                 R"(,"componentType":5125,"type":"SCALAR","count":)" + std::to_string(relief.indices.size()) + "}";
    meshes += comma + R"({"primitives":[{"attributes":{"POSITION":)" + position + R"(},"indices":)" + index + "}]}";
    nodes += comma + R"({"mesh":)" + std::to_string(i) + R"(,"translation":[)" + number(relief.place[0]) + "," +
             number(relief.place[1]) + "," + number(relief.place[2]) + "]}";
    list += comma + std::to_string(i);
  }
  tests::write_file(folder / "towns.bin", bytes);
  tests::write_file(folder / "towns.gltf", R"({"asset":{"version":"2.0"},"buffers":[{"uri":"towns.bin","byteLength":)" +
                                               std::to_string(bytes.size()) + R"(}],"bufferViews":[)" + views +
                                               R"(],"accessors":[)" + accessors + R"(],"meshes":[)" + meshes +
                                               R"(],"nodes":[)" + nodes + R"(],"scenes":[{"nodes":[)" + list + "]}]}");
  return folder / "towns.gltf";
}

class Towns {
 public:
  explicit Towns(std::size_t rays) : count_(rays) {
    for (const Point& place : kPlaces) {
      reliefs_.push_back(make_local_relief(random_, place));
    }
  }

  Status run() {
    RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t parts, build("wide.mill", "auto", 8));
    RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t narrow_parts, build("narrow.mill", "auto", 4));
    RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t no_parts, build("never.mill", "never", 8));
    if (parts != 2 || narrow_parts != 2 || no_parts != 0) {
      fail("the outer two are to have origins of their own, and none where none may");
    }
    for (std::size_t town = 0; town < reliefs_.size(); ++town) {
      for (const double distance : kDistances) {
        RAYMILL_RETURN_IF_ERROR(meet(town, distance));
      }
    }
    return {};
  }
  TownsPage page() { return {kTownsHead + lines_, passed_}; }

 private:
  void fail(const std::string& what) {
    std::printf("FAILED: %s\n", what.c_str());
    passed_ = false;
  }

  Result<std::uint64_t> build(const std::string& name, const std::string& origins, unsigned width) const {
    BuildConfig config = tests::small_pages();
    config.scenes = {write_scene(folder_, reliefs_)};
    config.output = folder_ / name;
    config.origins = origins;
    config.width = width;
    RAYMILL_ASSIGN_OR_RETURN(const BuildReport report, raymill::build(config));
    return report.parts;
  }

  // All modes at one town from one distance.
  Status meet(std::size_t town, double distance) {
    const std::vector<Ray64> rays = make_rays(random_, kPlaces[town], distance, count_);
    std::vector<Truth> truths;
    std::transform(rays.begin(), rays.end(), std::back_inserter(truths),
                   [&](const Ray64& ray) { return true_hit(reliefs_[town], ray); });
    for (const Mode mode : {Mode::fast, Mode::watertight, Mode::exact}) {
      RAYMILL_ASSIGN_OR_RETURN(const std::vector<Hit> hits, trace("wide.mill", mode, rays, {}));
      judge(town, distance, mode, rays, truths, hits);
      RAYMILL_RETURN_IF_ERROR(compare(mode, rays, hits));
    }
    if (distance == kDistances[0]) {
      RAYMILL_ASSIGN_OR_RETURN(const std::vector<Hit> hits, trace("never.mill", Mode::watertight, rays, {}));
      tell(town, distance, "watertight, `--origins never`", errors_of(reliefs_[town], rays, truths, hits));
    }
    return {};
  }

  void tell(std::size_t town, double distance, const std::string& who, Errors errors) {
    char from[32];
    std::snprintf(from, sizeof from, "%g m, ", distance);
    const std::string line = line_of(kNames[town], from + who, std::move(errors));
    lines_ += line;
    std::printf("%s", line.c_str());
    std::fflush(stdout);
  }

  void judge(std::size_t town, double distance, Mode mode, std::span<const Ray64> rays, std::span<const Truth> truths,
             std::span<const Hit> hits) {
    const std::string who(to_string(mode));
    const Errors errors = errors_of(reliefs_[town], rays, truths, hits);
    tell(town, distance, who, errors);
    if (std::any_of(hits.begin(), hits.end(),
                    [&](const Hit& hit) { return std::isfinite(hit.t) && hit.geometry_id != town; })) {
      fail(who + " hits another relief than the ray's");
    }
    if (mode != Mode::fast && (errors.wrong_hits > 0 || errors.most_off > 8 * (2 * distance + 1) * 0x1p-24)) {
      fail(who + " at " + kNames[town] + " has wrong hits, or is off the surface by more than its bound");
    }
  }

  // Every way to come to the same hits.
  Status compare(Mode mode, std::span<const Ray64> rays, std::span<const Hit> expected) {
    std::vector<EngineConfig> ways;
    for (const std::string& isa : available_isas()) {
      ways.emplace_back().isa = isa;
    }
    ways.emplace_back().threads = 3;
    ways.emplace_back().adversarial = true;
    ways.emplace_back().memory = 0;  // the least
    for (const char* store : {"wide.mill", "narrow.mill"}) {
      for (const EngineConfig& way : ways) {
        RAYMILL_ASSIGN_OR_RETURN(const std::vector<Hit> hits, trace(store, mode, rays, way));
        if (!std::equal(hits.begin(), hits.end(), expected.begin(), expected.end(), tests::same_bits)) {
          fail(std::string(store) + " gives other bits with isa '" + way.isa + "', " + std::to_string(way.threads) +
               " threads, memory " + std::to_string(way.memory) + (way.adversarial ? ", suspended everywhere" : ""));
        }
      }
    }
    return {};
  }

  Result<std::vector<Hit>> trace(const std::string& name, Mode mode, std::span<const Ray64> rays,
                                 EngineConfig config) const {
    if (config.memory == 0) {
      RAYMILL_ASSIGN_OR_RETURN(const auto engine, Engine::create({.memory = gibibytes(1), .threads = 1}));
      RAYMILL_ASSIGN_OR_RETURN(const auto store, engine->open(folder_ / name));
      RAYMILL_ASSIGN_OR_RETURN(const StoreInfo info, store->info());
      config.memory = info.least_memory_bytes + mebibytes(2);
    } else {
      config.memory = gibibytes(1);
    }
    config.threads = config.threads == 0 ? 1 : config.threads;
    RAYMILL_ASSIGN_OR_RETURN(const auto engine, Engine::create(config));
    RAYMILL_ASSIGN_OR_RETURN(const auto store, engine->open(folder_ / name));
    RAYMILL_ASSIGN_OR_RETURN(const auto job, store->trace({.mode = mode, .fields = Field::all, .float64 = true}));
    RAYMILL_RETURN_IF_ERROR(job->push64(rays));
    RAYMILL_RETURN_IF_ERROR(job->finish());
    std::vector<Hit> hits;
    while (const auto chunk = job->next()) {
      for (std::size_t i = 0; i < chunk->size(); ++i) {
        hits.push_back(chunk->hit(i));
      }
    }
    RAYMILL_RETURN_IF_ERROR(job->status());
    return hits;
  }

  const std::size_t count_;
  tests::Random random_{10000};
  std::vector<Relief> reliefs_;
  const tests::TempFolder folder_;
  std::string lines_;
  bool passed_ = true;
};

}  // namespace

Result<TownsPage> run_towns(std::size_t rays) {
  Towns towns(rays);
  RAYMILL_RETURN_IF_ERROR(towns.run());
  return towns.page();
}

}  // namespace raymill::extremes
