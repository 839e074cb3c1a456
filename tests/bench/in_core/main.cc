// raymill-in-core: rays per second with every page in memory, beside Embree's single-ray calls on the same rays.
//
//   raymill-in-core SCENE STORE RAYS.npy... [--query any] [--mode fast] [--isa avx2] [--repeat 7] [--engine]
//
// One thread each. A repetition runs the kernels, Embree and, with --engine, a job of the engine one after the other.
// Kernels and Embree are measured by their thread's CPU time, the engine, whose worker runs beside the caller who
// pushes and fetches, by the clock on the wall. Rays are read and hits are written by all. A ratio is taken within a
// repetition; its median, least and most are printed, one line of JSON for each file. Exit codes: 0; 1 hits differ from
// Embree's by more than --most-different; 2 it could not be run.
#include <time.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "client/cli/ray_file.h"
#include "tests/bench/in_core/resident_store.h"
#include "tests/support/embree_scene.h"
#include "traversal/engine.h"
#include "traversal/simd/float_mode.h"

namespace raymill::bench {
namespace {

// The time of a thread's work: what else runs on the machine takes from it only through the caches.
struct ThreadClock {
  static double now() {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  }
};
struct WallClock {
  static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
};

struct Options {
  std::string scene, store;
  std::vector<std::string> rays;
  std::string query = "closest", mode = "watertight", isa;
  unsigned repeat = 7;
  std::size_t batch_rays = 512;
  bool engine = false, no_embree = false;
  double most_different = 1e-3;
  std::size_t most_rays = std::numeric_limits<std::size_t>::max();
};

struct Subject {
  const ResidentStore& store;
  ResidentStore::Run run;
  const EmbreeScene* embree;
  Store* engine;  // null: left out
};

template <typename Clock, typename Work>
double seconds_of(Work&& work) {
  const double begin = Clock::now();
  work();
  return Clock::now() - begin;
}

void trace_by_embree(const EmbreeScene& scene, Query query, std::span<const Ray> rays, std::span<Hit> hits) {
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (query == Query::closest) {
      hits[i] = scene.closest_hit(rays[i]);
    } else {
      hits[i].t = scene.any_hit(rays[i]) ? 0 : std::numeric_limits<float>::infinity();
    }
  }
}

Status trace_by_engine(Store& store, const ResidentStore::Run& run, std::span<const Ray> rays, std::span<Hit> hits) {
  RAYMILL_ASSIGN_OR_RETURN(const auto job, store.trace({.query = run.query, .mode = run.mode}));
  RAYMILL_RETURN_IF_ERROR(job->push(rays));
  RAYMILL_RETURN_IF_ERROR(job->finish());
  while (const auto chunk = job->next()) {
    for (std::size_t i = 0; i < chunk->size(); ++i) {
      hits[chunk->first_ray() + i] = chunk->hit(i);
    }
  }
  return job->status();
}

// Hit or miss differs, or t by more than rounding explains.
std::size_t count_different(std::span<const Hit> a, std::span<const Hit> b) {
  std::size_t different = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const bool same = std::isinf(a[i].t) == std::isinf(b[i].t) &&
                      (std::isinf(a[i].t) || std::fabs(a[i].t - b[i].t) <= 1e-4F * std::fabs(b[i].t) + 1e-6F);
    different += same ? 0 : 1;
  }
  return different;
}

nlohmann::json spread(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {{"median", values[values.size() / 2]}, {"least", values.front()}, {"most", values.back()}};
}

Result<std::vector<Ray>> read_rays(const std::string& path, std::size_t most) {
  RAYMILL_ASSIGN_OR_RETURN(auto reader, client::RayFileReader::open(path));
  std::vector<Ray> rays(std::min<std::size_t>(reader.count(), most));
  RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read(rays));
  rays.resize(count);
  return rays;
}

Result<nlohmann::json> measure(const Subject& subject, const std::vector<Ray>& rays, unsigned repeat) {
  std::vector<Hit> ours(rays.size()), theirs(rays.size()), job(rays.size());
  std::vector<double> kernel_rates, embree_rates, engine_rates, kernel_ratios, engine_ratios;
  const auto million = static_cast<double>(rays.size()) / 1e6;
  Result<traversal::KernelCounters> counters = traversal::KernelCounters{};
  Status status;
  for (unsigned i = 0; i < repeat && counters.ok() && status.ok(); ++i) {
    const double kernel = seconds_of<ThreadClock>([&] { counters = subject.store.trace(subject.run, rays, ours); });
    kernel_rates.push_back(million / kernel);
    if (subject.embree != nullptr) {
      const double embree =
          seconds_of<ThreadClock>([&] { trace_by_embree(*subject.embree, subject.run.query, rays, theirs); });
      embree_rates.push_back(million / embree);
      kernel_ratios.push_back(embree / kernel);
    }
    if (subject.engine != nullptr) {
      const double engine =
          seconds_of<WallClock>([&] { status = trace_by_engine(*subject.engine, subject.run, rays, job); });
      engine_rates.push_back(million / engine);
      if (subject.embree != nullptr) {
        engine_ratios.push_back(million / embree_rates.back() / engine);
      }
    }
  }
  RAYMILL_RETURN_IF_ERROR(counters.ok() ? status : counters.status());
  const auto count = static_cast<double>(rays.size());
  nlohmann::json line{{"rays", rays.size()},
                      {"kernel_mrays_per_second", spread(kernel_rates)},
                      {"nodes_per_ray", static_cast<double>(counters->nodes_visited) / count},
                      {"triangles_per_ray", static_cast<double>(counters->triangles_tested) / count}};
  if (subject.embree != nullptr) {
    line["embree_mrays_per_second"] = spread(embree_rates);
    line["kernel_ratio"] = spread(kernel_ratios);
    line["different"] = count_different(ours, theirs);
  }
  if (subject.engine != nullptr) {
    line["engine_mrays_per_second"] = spread(engine_rates);
    line["engine_different"] = count_different(job, ours);
    if (subject.embree != nullptr) {
      line["engine_ratio"] = spread(engine_ratios);
    }
  }
  return line;
}

Result<ResidentStore::Run> choose_run(const Options& options) {
  ResidentStore::Run run;
  run.batch_rays = options.batch_rays;
  RAYMILL_ASSIGN_OR_RETURN(run.query, parse_query(options.query));
  RAYMILL_ASSIGN_OR_RETURN(run.mode, parse_mode(options.mode));
  run.isa = traversal::runnable_isas().front();
  for (const traversal::Isa isa : traversal::runnable_isas()) {
    run.isa = to_string(isa) == options.isa ? isa : run.isa;
  }
  if (!options.isa.empty() && to_string(run.isa) != options.isa) {
    return {ErrorCode::invalid_argument, "'" + options.isa + "' is no instruction set of this machine"};
  }
  return run;
}

// Embree is robust where we are watertight.
Status run(const Options& options, bool& all_alike) {
  RAYMILL_ASSIGN_OR_RETURN(const auto store, ResidentStore::load(options.store));
  RAYMILL_ASSIGN_OR_RETURN(const auto run, choose_run(options));
  std::optional<EmbreeScene> embree;
  if (!options.no_embree) {
    RAYMILL_ASSIGN_OR_RETURN(auto scene,
                             EmbreeScene::create({.scenes = {options.scene}, .robust = run.mode == Mode::watertight}));
    embree.emplace(std::move(scene));
  }
  std::shared_ptr<Store> opened;
  std::unique_ptr<Engine> engine;
  if (options.engine) {
    EngineConfig config{.memory = gibibytes(64), .threads = 1, .isa = std::string(to_string(run.isa))};
    RAYMILL_ASSIGN_OR_RETURN(engine, Engine::create(config));
    RAYMILL_ASSIGN_OR_RETURN(opened, engine->open(options.store));
  }
  for (const std::string& file : options.rays) {
    RAYMILL_ASSIGN_OR_RETURN(const auto rays, read_rays(file, options.most_rays));
    RAYMILL_ASSIGN_OR_RETURN(auto line,
                             measure({store, run, embree ? &*embree : nullptr, opened.get()}, rays, options.repeat));
    line["name"] = std::string(to_string(run.query)) + "_hit/mbvh" + std::to_string(store.width()) + "/" +
                   std::string(to_string(run.isa)) + "/" + std::filesystem::path(options.store).stem().string() + "/" +
                   std::filesystem::path(file).stem().string();
    line["mode"] = to_string(run.mode);
    line["repetitions"] = options.repeat;
    std::cout << line.dump() << std::endl;
    const auto most = options.most_different * static_cast<double>(rays.size());
    all_alike = all_alike && line.value("different", 0.0) <= most && line.value("engine_different", 0) == 0;
  }
  return {};
}

int main(int argc, char** argv) {
  Options options;
  CLI::App app("Traces rays with every page in memory, beside Embree.", "raymill-in-core");
  app.add_option("SCENE", options.scene, "The scene file that the store was built from")->required();
  app.add_option("STORE", options.store, "The store")->required();
  app.add_option("RAYS", options.rays, "Ray files")->required();
  app.add_option("--query", options.query, "closest or any")->capture_default_str();
  app.add_option("--mode", options.mode, "watertight (beside Embree's robust mode) or fast")->capture_default_str();
  app.add_option("--isa", options.isa, "Of our kernels; left out: the best this machine has");
  app.add_option("--repeat", options.repeat, "Repetitions")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--batch", options.batch_rays, "Rays that a kernel is given at once")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  app.add_option("--most-rays", options.most_rays, "Rays of a file that are traced; left out: all");
  app.add_flag("--engine", options.engine, "Trace by the engine too");
  app.add_flag("--no-embree", options.no_embree, "Leave Embree out, for a profile");
  app.add_option("--most-different", options.most_different, "Part of the rays whose hits may differ")
      ->capture_default_str();
  constexpr int kCannotRun = 2;
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kCannotRun;
  }
  const traversal::IeeeScope ieee;
  bool all_alike = true;
  if (const Status status = run(options, all_alike); !status.ok()) {
    std::fprintf(stderr, "raymill-in-core: %s\n", status.message().c_str());
    return kCannotRun;
  }
  return all_alike ? 0 : 1;
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
