// raymill-in-core: rays per second with every page in memory, beside Embree on the same rays.
//
//   raymill-in-core SCENE STORE RAYS.npy... [--query any] [--mode fast] [--modes] [--all-calls] [--sort] [--engine]
//
// One thread each. A repetition runs the kernels, Embree's single rays and what else the options name, one after the
// other. The engine, whose worker runs beside the caller who pushes and fetches, is measured by the clock on the wall,
// all others by their thread's CPU time; where rays are sorted, that is part of the time. Rays are read and hits are
// written by all. A ratio, of the kernels' rate to another's, is taken within a repetition (with --modes, of a kernel's
// rate in --mode to its rate in the others: what they cost); its median, least and most are printed, one line of JSON
// for each file. Exit codes: 0; 1 hits of ours differ, or Embree's in more of the rays than --most-different; 2 it
// could not be run.
#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <iostream>
#include <nlohmann/json.hpp>

#include "storage/base/quotes.h"
#include "tests/bench/in_core/embree_calls.h"
#include "tests/bench/in_core/resident_store.h"
#include "tests/bench/tool.h"
#include "tests/support/embree_files.h"
#include "tests/support/tool.h"
#include "traversal/engine.h"
#include "traversal/ray_order.h"

namespace raymill::bench {
namespace {

struct ThreadClock {
  static double now() { return thread_seconds(); }
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
  bool engine = false, no_embree = false, all_calls = false, coherent = false, sort = false, modes = false;
  double most_different = 1e-3;
  std::size_t most_rays = std::numeric_limits<std::size_t>::max();
};

// Traces rays in sorted order by trace(rays, hits) and puts the hits where they belong.
template <typename Trace>
auto trace_sorted(std::span<const Ray> rays, std::span<Hit> hits, Trace&& trace) {
  traversal::RayOrder sorter;
  const auto order = sorter.sort(rays);
  std::vector<Ray> sorted(rays.size());
  for (std::size_t i = 0; i < rays.size(); ++i) {
    sorted[i] = rays[order[i]];
  }
  std::vector<Hit> found(rays.size());
  auto result = trace(std::span<const Ray>(sorted), std::span<Hit>(found));
  for (std::size_t i = 0; i < rays.size(); ++i) {
    hits[order[i]] = found[i];
  }
  return result;
}

/// One way to trace rays.
struct Tracer {
  std::string name;
  bool is_ours = false;
  bool by_wall_clock = false;
  std::size_t base = 0;  // the tracer, this one or one before, that ratios are to
  std::function<Status(std::span<const Ray>, std::span<Hit>)> trace;
};

template <typename Clock, typename Work>
double seconds_of(Work&& work) {
  const double begin = Clock::now();
  work();
  return Clock::now() - begin;
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

bool same_bits(const Hit& a, const Hit& b) {
  return std::bit_cast<std::uint32_t>(a.t) == std::bit_cast<std::uint32_t>(b.t) &&
         std::bit_cast<std::uint32_t>(a.u) == std::bit_cast<std::uint32_t>(b.u) &&
         std::bit_cast<std::uint32_t>(a.v) == std::bit_cast<std::uint32_t>(b.v) && a.primitive_id == b.primitive_id &&
         a.geometry_id == b.geometry_id;
}

// Hit or miss is the same, and t but for what rounding explains.
bool alike(const Hit& a, const Hit& b) {
  return std::isinf(a.t) == std::isinf(b.t) &&
         (std::isinf(a.t) || std::fabs(a.t - b.t) <= 1e-4F * std::fabs(b.t) + 1e-6F);
}

nlohmann::json spread(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {{"median", values[values.size() / 2]}, {"least", values.front()}, {"most", values.back()}};
}

struct Measured {
  std::vector<Hit> hits;
  std::vector<double> rates;   // million rays a second
  std::vector<double> ratios;  // of the base's rate to this one's
};

// Every tracer once, one after the other; that as often as `repeat`.
Result<std::vector<Measured>> measure(const std::vector<Tracer>& tracers, const std::vector<Ray>& rays,
                                      unsigned repeat) {
  std::vector<Measured> measured(tracers.size());
  for (unsigned repetition = 0; repetition < repeat; ++repetition) {
    for (std::size_t i = 0; i < tracers.size(); ++i) {
      Measured& its = measured[i];
      its.hits.resize(rays.size());
      Status status;
      const auto work = [&] { status = tracers[i].trace(rays, its.hits); };
      const double seconds = tracers[i].by_wall_clock ? seconds_of<WallClock>(work) : seconds_of<ThreadClock>(work);
      RAYMILL_RETURN_IF_ERROR(status);
      its.rates.push_back(static_cast<double>(rays.size()) / 1e6 / seconds);
      its.ratios.push_back(measured[tracers[i].base].rates.back() / its.rates.back());
    }
  }
  return measured;
}

// Hits of all that are ours are to be the same bits; Embree's may differ at edges.
nlohmann::json told(const std::vector<Tracer>& tracers, const std::vector<Measured>& measured) {
  nlohmann::json lines = nlohmann::json::object();
  for (std::size_t i = 0; i < tracers.size(); ++i) {
    std::size_t different = 0;
    for (std::size_t ray = 0; ray < measured[i].hits.size(); ++ray) {
      const Hit &first = measured[0].hits[ray], &its = measured[i].hits[ray];
      different += (tracers[i].is_ours ? same_bits(first, its) : alike(first, its)) ? 0 : 1;
    }
    lines[tracers[i].name] = {{"mrays_per_second", spread(measured[i].rates)},
                              {"kernel_ratio", spread(measured[i].ratios)},
                              {"different", different}};
  }
  return lines;
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
    return {ErrorCode::invalid_argument, in_quotes(options.isa) + " is no instruction set of this machine"};
  }
  return run;
}

struct Scene {
  ResidentStore store;
  ResidentStore::Run run;
  std::optional<EmbreeScene> embree;
  std::unique_ptr<Engine> engine;
  std::shared_ptr<Store> opened;
};

// Embree is robust where we are watertight or exact.
Result<Scene> load(const Options& options) {
  RAYMILL_ASSIGN_OR_RETURN(auto store, ResidentStore::load(options.store));
  RAYMILL_ASSIGN_OR_RETURN(const auto run, choose_run(options));
  Scene scene{.store = std::move(store), .run = run, .embree = {}, .engine = {}, .opened = {}};
  if (!options.no_embree) {
    RAYMILL_ASSIGN_OR_RETURN(auto embree, embree_of_files({options.scene}, {.robust = run.mode != Mode::fast}));
    scene.embree.emplace(std::move(embree));
  }
  if (options.engine) {
    EngineConfig config{.memory = gibibytes(64), .threads = 1, .isa = std::string(to_string(run.isa))};
    RAYMILL_ASSIGN_OR_RETURN(scene.engine, Engine::create(config));
    RAYMILL_ASSIGN_OR_RETURN(scene.opened, scene.engine->open(options.store));
  }
  return scene;
}

// The kernels of both layouts in the other modes. Their hits are not the first's to the bit.
void add_other_modes(std::vector<Tracer>& tracers, const Scene& scene) {
  for (const Mode mode : {Mode::fast, Mode::watertight, Mode::exact}) {
    if (mode == scene.run.mode) {
      continue;
    }
    ResidentStore::Run other = scene.run;
    other.mode = mode;
    for (const bool is_expanded : {true, false}) {
      const std::string layout = is_expanded ? "expanded" : "compact";
      const auto base =
          std::find_if(tracers.begin(), tracers.end(), [&](const Tracer& tracer) { return tracer.name == layout; });
      tracers.push_back({.name = layout + "/" + std::string(to_string(mode)),
                         .base = static_cast<std::size_t>(base - tracers.begin()),
                         .trace = [&scene, other, is_expanded](std::span<const Ray> rays, std::span<Hit> hits) {
                           return is_expanded ? scene.store.trace_expanded(other, rays, hits).status()
                                              : scene.store.trace(other, rays, hits).status();
                         }});
    }
  }
}

// The kernels for the expanded layout come first: the others' ratios are to them.
std::vector<Tracer> tracers_of(const Scene& scene, const Options& options, traversal::KernelCounters& counters) {
  std::vector<Tracer> tracers;
  const auto add = [&](const std::string& name, bool is_ours, bool is_sorted_too, auto trace) {
    tracers.push_back({.name = name, .is_ours = is_ours, .trace = trace});
    if (is_sorted_too && options.sort) {
      tracers.push_back({.name = "sort+" + name,
                         .is_ours = is_ours,
                         .trace = [trace](std::span<const Ray> rays, std::span<Hit> hits) {
                           return trace_sorted(rays, hits, trace);
                         }});
    }
  };
  add("expanded", true, true, [&](std::span<const Ray> rays, std::span<Hit> hits) -> Status {
    RAYMILL_ASSIGN_OR_RETURN(counters, scene.store.trace_expanded(scene.run, rays, hits));
    return {};
  });
  add("compact", true, true, [&](std::span<const Ray> rays, std::span<Hit> hits) {
    return scene.store.trace(scene.run, rays, hits).status();
  });
  if (options.modes) {
    add_other_modes(tracers, scene);
  }
  if (scene.embree) {
    constexpr std::pair<const char*, EmbreeCall> kCalls[] = {{"embree1", EmbreeCall::single},
                                                             {"embree8", EmbreeCall::packet8},
                                                             {"embree16", EmbreeCall::packet16},
                                                             {"embree-stream", EmbreeCall::stream}};
    for (const auto& [name, call] : kCalls) {
      if (call != EmbreeCall::single && !options.all_calls) {
        continue;
      }
      const EmbreeBatch batch{.call = call, .query = scene.run.query, .coherent = options.coherent};
      add(name, false, call == EmbreeCall::single || call == EmbreeCall::packet16,
          [&scene, batch](std::span<const Ray> rays, std::span<Hit> hits) {
            trace_by_embree(*scene.embree, batch, rays, hits);
            return Status();
          });
    }
  }
  if (scene.opened) {
    tracers.push_back({.name = "engine",
                       .is_ours = true,
                       .by_wall_clock = true,
                       .trace = [&scene](std::span<const Ray> rays, std::span<Hit> hits) {
                         return trace_by_engine(*scene.opened, scene.run, rays, hits);
                       }});
  }
  return tracers;
}

Result<bool> run(const Options& options) {
  bool all_alike = true;
  RAYMILL_ASSIGN_OR_RETURN(const Scene scene, load(options));
  traversal::KernelCounters counters;
  const std::vector<Tracer> tracers = tracers_of(scene, options, counters);
  for (const std::string& file : options.rays) {
    RAYMILL_ASSIGN_OR_RETURN(const auto rays, read_rays(file, options.most_rays));
    RAYMILL_ASSIGN_OR_RETURN(const auto measured, measure(tracers, rays, options.repeat));
    const auto count = static_cast<double>(rays.size());
    nlohmann::json line{{"name", std::string(to_string(scene.run.query)) + "_hit/mbvh" +
                                     std::to_string(scene.store.width()) + "/" + std::string(to_string(scene.run.isa)) +
                                     "/" + std::filesystem::path(options.store).stem().string() + "/" +
                                     std::filesystem::path(file).stem().string()},
                        {"mode", to_string(scene.run.mode)},
                        {"rays", rays.size()},
                        {"repetitions", options.repeat},
                        {"nodes_per_ray", static_cast<double>(counters.nodes_visited) / count},
                        {"triangles_per_ray", static_cast<double>(counters.triangles_tested) / count},
                        {"tracers", told(tracers, measured)}};
    std::cout << line.dump() << std::endl;
    for (const Tracer& tracer : tracers) {
      const auto different = line["tracers"][tracer.name]["different"].get<double>();
      all_alike = all_alike && different <= (tracer.is_ours ? 0 : options.most_different * count);
    }
  }
  return all_alike;
}

int main(int argc, char** argv) {
  Options options;
  tests::Tool tool("raymill-in-core", "Traces rays with every page in memory, beside Embree.");
  tool.option("SCENE", options.scene, "The scene file that the store was built from").required();
  tool.option("STORE", options.store, "The store").required();
  tool.option("RAYS", options.rays, "Ray files").required();
  tool.option("--query", options.query, "closest or any");
  tool.option("--mode", options.mode, "watertight or exact (beside Embree's robust mode), or fast");
  tool.option("--isa", options.isa, "Of our kernels; left out: the best this machine has");
  tool.option("--repeat", options.repeat, "Repetitions").between(1, 1000);
  tool.option("--batch", options.batch_rays, "Rays that a kernel is given at once").between(1, 1 << 20);
  tool.option("--most-rays", options.most_rays, "Rays of a file that are traced; left out: all");
  tool.flag("--modes", options.modes, "The kernels in the other modes too: what they cost");
  tool.flag("--engine", options.engine, "Trace by the engine too");
  tool.flag("--all-calls", options.all_calls, "Embree's packets of 8 and 16 and its streams too");
  tool.flag("--coherent", options.coherent, "Tell Embree's packets and streams that the rays are coherent");
  tool.flag("--sort", options.sort, "The kernels, single rays and packets of 16 after sorting the file's rays too");
  tool.flag("--no-embree", options.no_embree, "Leave Embree out, for a profile");
  tool.option("--most-different", options.most_different, "Part of the rays whose hits may differ");
  return tool.run(argc, argv, [&] { return run(options); });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::main(argc, argv); }
