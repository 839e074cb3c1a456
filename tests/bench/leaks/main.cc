// raymill-leaks: rays from inside closed meshes, aimed at vertices and edges, that hit nothing.
//
//   raymill-leaks [--rays 100M] [--scenes FOLDER] [--query any] [--positions lattice:12b] [--isa ISA]
//
// Each mesh, as its store decodes it, is shown to be closed (each edge is passed as often in one direction as in the
// other), each origin to be inside (the mesh winds around it, by the sum of solid angles). Of the rays, a third aim at
// a vertex, a third at a point of an edge, a third by up to one rounding in each coordinate of dir past one of these.
// The public Engine answers them in each mode, Embree in its default and in its robust mode, the same rays in the same
// run. A line for each mesh. Exit codes: 0; 1 a miss in watertight or exact, or a mesh that is not closed; 2 it could
// not be run.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <thread>

#include "client/cli/bench/embree_scene.h"
#include "client/cli/bench/store_triangles.h"
#include "client/cli/parse.h"
#include "tests/bench/leaks/meshes.h"
#include "tests/support/rays.h"
#include "tests/support/stores.h"
#include "tests/support/tool.h"
#include "traversal/engine.h"

namespace raymill::bench {
namespace {

using client::EmbreeScene;

struct Options {
  std::string rays = "1M", scenes, mesh, isa, query = "closest", positions = "float32";
  std::uint64_t seed = 1;
  std::size_t origins = 256, boxes = 500;
  std::uint32_t page_bytes = BuildConfig().page_bytes;
  unsigned threads = 0, grid_bits = 14;
};

constexpr std::size_t kBatchRays = 1 << 18;
constexpr std::array<Mode, 3> kModes = {Mode::fast, Mode::watertight, Mode::exact};

// Numbers of one mesh's run. Misses in the order of kModes, then Embree's default and robust mode.
struct Counts {
  std::uint64_t rays = 0;
  std::array<std::uint64_t, 5> misses{};
};

std::uint64_t misses_of(std::span<const Ray> rays, Query query, const EmbreeScene& scene, unsigned threads) {
  std::vector<std::uint64_t> misses(threads);
  std::vector<std::thread> workers;
  for (unsigned worker = 0; worker < threads; ++worker) {
    workers.emplace_back([&, worker] {
      std::uint64_t count = 0;
      for (std::size_t i = worker; i < rays.size(); i += threads) {
        count += (query == Query::any ? scene.any_hit(rays[i]) : scene.closest(rays[i])) ? 0 : 1;
      }
      misses[worker] = count;
    });
  }
  std::uint64_t sum = 0;
  for (unsigned worker = 0; worker < threads; ++worker) {
    workers[worker].join();
    sum += misses[worker];
  }
  return sum;
}

Result<std::uint64_t> misses_of(std::span<const Ray> rays, const TraceConfig& config, Store& store) {
  RAYMILL_ASSIGN_OR_RETURN(const auto job, store.trace(config));
  RAYMILL_RETURN_IF_ERROR(job->push(rays));
  RAYMILL_RETURN_IF_ERROR(job->finish());
  std::uint64_t misses = 0, answers = 0;
  while (const auto chunk = job->next()) {
    answers += chunk->size();
    for (std::size_t i = 0; i < chunk->size(); ++i) {
      misses += std::isfinite(chunk->hit(i).t) ? 0 : 1;
    }
  }
  RAYMILL_RETURN_IF_ERROR(job->status());
  return answers == rays.size() ? Result<std::uint64_t>(misses)
                                : Status(ErrorCode::internal, "some rays have no answer");
}

Ray aimed_ray(const Mesh& mesh, const Vec3f& origin, tests::Random& random) {
  const Corners& c = mesh[random.below(static_cast<std::uint32_t>(mesh.size()))];
  const std::size_t k = random.below(3);
  const Vec3f &a = c[k], &b = c[(k + 1) % 3];
  const std::uint32_t kind = random.below(6);
  Vec3f target = a;
  if (kind % 2 == 1) {
    const float s = random.below(2) == 0 ? 0.5F : random.uniform(0, 1);
    target = {a.x + (b.x - a.x) * s, a.y + (b.y - a.y) * s, a.z + (b.z - a.z) * s};
  }
  Ray ray = tests::ray_towards(origin, target);
  for (std::size_t axis = 0; axis < 3 && kind >= 4; ++axis) {
    const float ends[3] = {-INFINITY, ray.dir[axis], INFINITY};
    ray.dir[axis] = std::nextafter(ray.dir[axis], ends[random.below(3)]);
  }
  return ray;
}

class Leaks {
 public:
  explicit Leaks(const Options& options, std::uint64_t rays, Query query)
      : options_(options), rays_(rays), query_(query) {
    threads_ = options.threads > 0 ? options.threads : std::max(1U, std::thread::hardware_concurrency());
  }

  Status run() {
    RAYMILL_ASSIGN_OR_RETURN(const auto meshes, this->meshes());
    std::printf("%-24s %9s %11s %8s %8s %7s %10s %8s %10s %8s %8s %8s\n", "mesh", "triangles", "edges by 2", "by more",
                "unpaired", "origins", "rays", "fast", "watertight", "exact", "embree", "robust");
    for (const NamedMesh& mesh : meshes) {
      RAYMILL_RETURN_IF_ERROR(run(mesh, rays_ / meshes.size()));
    }
    return {};
  }
  [[nodiscard]] bool passed() const { return passed_; }

 private:
  Result<std::vector<NamedMesh>> meshes() const {
    std::vector<NamedMesh> meshes = {far_sphere(), rough_sphere(), box_soup(options_.boxes)};
    if (!options_.scenes.empty()) {
      const std::string file = options_.scenes + "/dragon_attenuation/DragonAttenuation.glb";
      RAYMILL_ASSIGN_OR_RETURN(NamedMesh dragon, closed_parts_of("dragon_attenuation", file));
      meshes.push_back(on_integer_grid(dragon, options_.grid_bits));
      meshes.push_back(std::move(dragon));
    }
    if (!options_.mesh.empty()) {
      std::erase_if(meshes, [this](const NamedMesh& mesh) { return mesh.name != options_.mesh; });
    }
    return meshes.empty() ? Status(ErrorCode::invalid_argument, "there is no mesh " + options_.mesh)
                          : Result<std::vector<NamedMesh>>(std::move(meshes));
  }

  Status run(const NamedMesh& named, std::uint64_t rays) {
    const tests::TempFolder folder;
    const std::string scene = folder / "mesh.glb", store = folder / "mesh.mill";
    tests::write_file(scene, tests::glb({named.mesh}));
    RAYMILL_ASSIGN_OR_RETURN([[maybe_unused]] const BuildReport report, build({.scenes = {scene},
                                                                               .output = store,
                                                                               .positions = options_.positions,
                                                                               .page_bytes = options_.page_bytes,
                                                                               .threads = threads_}));
    MeshSink decoded;  // what is closed, and aimed at, is what the kernels see
    RAYMILL_RETURN_IF_ERROR(client::read_store_triangles(store, decoded));
    tests::Random random(options_.seed);
    const Edges edges = edges_of(decoded.mesh);
    const auto origins = inside_points(decoded.mesh, random, options_.origins, named.origin_step);
    if (origins.empty()) {
      return {ErrorCode::internal, named.name + ": no point inside was found"};
    }
    RAYMILL_ASSIGN_OR_RETURN(const Counts counts, trace(store, decoded.mesh, origins, rays, random));
    print(named, decoded.mesh.size(), edges, origins.size(), counts);
    passed_ = passed_ && edges.closed() && counts.misses[1] == 0 && counts.misses[2] == 0;
    return {};
  }

  static void print(const NamedMesh& mesh, std::size_t triangles, const Edges& edges, std::size_t origins,
                    const Counts& counts) {
    const auto number = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
    std::printf("%-24s %9zu %11llu %8llu %8llu %7zu %10llu", mesh.name.c_str(), triangles, number(edges.by_two),
                number(edges.by_more), number(edges.unpaired), origins, number(counts.rays));
    constexpr int kWidths[] = {8, 10, 8, 8, 8};
    for (std::size_t i = 0; i < counts.misses.size(); ++i) {
      std::printf(" %*llu", kWidths[i], number(counts.misses[i]));
    }
    std::printf("%s%s\n", mesh.note.empty() ? "" : "  ", mesh.note.c_str());
    std::fflush(stdout);
  }

  Result<Counts> trace(const std::string& path, const Mesh& mesh, const std::vector<Vec3f>& origins, std::uint64_t rays,
                       tests::Random& random) const {
    RAYMILL_ASSIGN_OR_RETURN(const auto engine,
                             Engine::create({.memory = gibibytes(4), .threads = threads_, .isa = options_.isa}));
    RAYMILL_ASSIGN_OR_RETURN(const auto store, engine->open(path));
    const auto fill = [&](storage::TriangleSink& sink) { return sink.add(tests::triangles_of({mesh})); };
    RAYMILL_ASSIGN_OR_RETURN(const EmbreeScene plain, EmbreeScene::create({}, fill));
    RAYMILL_ASSIGN_OR_RETURN(const EmbreeScene robust, EmbreeScene::create({.robust = true}, fill));
    Counts counts;
    std::vector<Ray> batch;
    while (counts.rays < rays) {
      batch.resize(std::min<std::uint64_t>(kBatchRays, rays - counts.rays));
      for (Ray& ray : batch) {
        ray = aimed_ray(mesh, origins[random.below(static_cast<std::uint32_t>(origins.size()))], random);
      }
      for (std::size_t i = 0; i < kModes.size(); ++i) {
        const TraceConfig config{.query = query_, .mode = kModes[i], .fields = Field::t};
        RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t misses, misses_of(batch, config, *store));
        counts.misses[i] += misses;
      }
      counts.misses[3] += misses_of(batch, query_, plain, threads_);
      counts.misses[4] += misses_of(batch, query_, robust, threads_);
      counts.rays += batch.size();
    }
    return counts;
  }

  const Options& options_;
  std::uint64_t rays_;
  Query query_;
  unsigned threads_ = 1;
  bool passed_ = true;
};

int main(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-leaks", "Rays from inside closed meshes, aimed at vertices and edges, that hit nothing.");
  tool.option("--rays", options.rays, "In all, a part of them for each mesh");
  tool.option("--scenes", options.scenes, "Folder of the scenes: the dragon too");
  tool.option("--mesh", options.mesh, "This mesh alone").type("NAME");
  tool.option("--query", options.query, "closest or any").one_of({"closest", "any"});
  tool.option("--positions", options.positions, "Of the stores, as 'raymill build' takes it");
  tool.option("--page-bytes", options.page_bytes, "Of the stores' pages: the smaller, the more rays at their borders")
      .between(16 << 10, 1 << 20);
  tool.option("--isa", options.isa, "Of our kernels; left out: the best this machine has");
  tool.option("--threads", options.threads, "0: one for each core");
  tool.option("--origins", options.origins, "Points inside each mesh").between(1, 1 << 20);
  tool.option("--boxes", options.boxes, "Of the box soup").between(1, 1 << 20);
  tool.option("--grid-bits", options.grid_bits, "Of the dragon on an integer grid").between(4, 23);
  tool.option("--seed", options.seed, "Of origins and rays");
  return tool.run(argc, argv, [&]() -> Result<bool> {
    RAYMILL_ASSIGN_OR_RETURN(const std::uint64_t rays, client::parse_count(options.rays));
    RAYMILL_ASSIGN_OR_RETURN(const Query query, parse_query(options.query));
    Leaks leaks(options, rays, query);
    RAYMILL_RETURN_IF_ERROR(leaks.run());
    std::printf(
        "again: raymill-leaks --rays %s --query %s --positions %s --page-bytes %u --seed %llu --origins %zu"
        " --boxes %zu --grid-bits %u%s\n",
        options.rays.c_str(), options.query.c_str(), options.positions.c_str(), options.page_bytes,
        static_cast<unsigned long long>(options.seed), options.origins, options.boxes, options.grid_bits,
        options.scenes.empty() ? "" : " --scenes FOLDER");
    return leaks.passed();
  });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
