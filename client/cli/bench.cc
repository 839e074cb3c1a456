// bench: how fast a store is traced on this machine, under this budget.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <vector>

#include "client/cli/batch.h"
#include "client/cli/bench/embree_scene.h"
#include "client/cli/bench/store_triangles.h"
#include "client/cli/camera.h"
#include "client/cli/options.h"
#include "client/cli/random.h"
#include "client/cli/ray_maker.h"
#include "client/cli/verbs.h"

namespace raymill::client {

namespace {

using nlohmann::json;

struct BenchOptions {
  std::string store;
  std::vector<RayKind> kinds = {RayKind::primary, RayKind::bounce, RayKind::shadow, RayKind::ao, RayKind::random};
  std::uint64_t count = 1'000'000;
  std::uint64_t seed = 1;
  unsigned repeat = 3;
  Mode mode = Mode::watertight;
  std::string camera;
  bool shuffle = false;
  bool embree = false;
  ServiceOptions service;
  std::string progress;
  bool json = false;
};

constexpr std::uint64_t kMostRays = std::uint64_t{1} << 32;
constexpr std::uint64_t kOrderSalt = 5;

Result<std::vector<RayKind>> parse_kinds(std::string_view text) {
  std::vector<RayKind> kinds;
  while (true) {
    const std::size_t comma = text.find(',');
    RAYMILL_ASSIGN_OR_RETURN(const RayKind kind, parse_ray_kind(text.substr(0, comma)));
    kinds.push_back(kind);
    if (comma == std::string_view::npos) {
      return kinds;
    }
    text.remove_prefix(comma + 1);
  }
}

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

json spread(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {{"median", values[values.size() / 2]}, {"least", values.front()}, {"most", values.back()}};
}

// Hit or miss differs, or t by more than rounding explains.
std::uint64_t count_different(std::span<const float> a, std::span<const float> b) {
  std::uint64_t different = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const bool same = std::isinf(a[i]) == std::isinf(b[i]) &&
                      (std::isinf(a[i]) || std::fabs(a[i] - b[i]) <= 1e-4F * std::fabs(b[i]) + 1e-6F);
    different += same ? 0 : 1;
  }
  return different;
}

// The rays by rtcIntersect1 or rtcOccluded1, dealt to threads; returns the seconds.
double trace_by_embree(const EmbreeScene& scene, Query query, unsigned threads, std::span<const Ray> rays,
                       std::span<float> distances) {
  constexpr std::size_t kPart = 4096;
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t begin = next.fetch_add(kPart); begin < rays.size(); begin = next.fetch_add(kPart)) {
      for (std::size_t i = begin; i < std::min(begin + kPart, rays.size()); ++i) {
        if (query == Query::closest) {
          distances[i] = scene.closest_hit(rays[i]).t;
        } else {
          distances[i] = scene.any_hit(rays[i]) ? 0 : std::numeric_limits<float>::infinity();
        }
      }
    }
  };
  const auto begin = std::chrono::steady_clock::now();
  std::vector<std::thread> others;
  for (unsigned i = 1; i < threads; ++i) {
    others.emplace_back(work);
  }
  work();
  for (std::thread& other : others) {
    other.join();
  }
  return seconds_since(begin);
}

class Bench {
 public:
  explicit Bench(const BenchOptions& options, ProgressStyle style) : options_(options), progress_(style) {}

  // The buffers are there before the engine, which counts what the process holds; Embree comes after it, for it is not
  // under the limit.
  Status open() {
    rays_.resize(options_.count);
    ours_.resize(options_.count);
    theirs_.resize(options_.embree ? options_.count : 0);
    buffer_.resize(buffer_rays(options_.service.memory));
    RAYMILL_ASSIGN_OR_RETURN(open_, open_store(options_.service, options_.store));
    RAYMILL_ASSIGN_OR_RETURN(info_, open_.store->info());
    RAYMILL_ASSIGN_OR_RETURN(camera_, choose_camera(options_.camera, info_, picture_of(options_.count)));
    info_.metadata_json = std::string();  // can be large, and is not needed any more
    if (options_.embree) {
      RAYMILL_ASSIGN_OR_RETURN(EmbreeScene scene, embree_scene());
      embree_.emplace(std::move(scene));
    }
    return {};
  }

  // Instances become Embree's.
  [[nodiscard]] Result<EmbreeScene> embree_scene() const {
    const EmbreeScene::Config config{.robust = options_.mode != Mode::fast};
    if (info_.instances > 0) {
      RAYMILL_ASSIGN_OR_RETURN(const PlacedTriangles placed, read_placed_triangles(options_.store));
      return EmbreeScene::create(config, placed);
    }
    return EmbreeScene::create(
        config, [this](storage::TriangleSink& sink) { return read_store_triangles(options_.store, sink); });
  }

  // The line of one kind.
  Result<json> run(RayKind kind) {
    RAYMILL_RETURN_IF_ERROR(make(kind));
    const Query query = query_of(kind);
    const auto million = static_cast<double>(rays_.size()) / 1e6;
    std::vector<double> rates, embree_rates, ratios;
    const JobStats before = stats_;
    for (unsigned i = 0; i < options_.repeat; ++i) {
      RAYMILL_ASSIGN_OR_RETURN(const double seconds, trace(kind));
      rates.push_back(million / seconds);
      if (embree_) {
        const unsigned threads = options_.service.thread_count();
        embree_rates.push_back(million / trace_by_embree(*embree_, query, threads, rays_, theirs_));
        ratios.push_back(rates.back() / embree_rates.back());
      }
    }
    const auto count = static_cast<double>(rays_.size());
    json line{{"name", std::string(to_string(query)) + "_hit/" + std::string(to_string(kind)) +
                           (options_.shuffle ? "_shuffled" : "")},
              {"kernel", stats_.kernel},
              {"rays", rays_.size()},
              {"hits", stats_.hits},
              {"repetitions", options_.repeat},
              {"first_mrays_per_second", rates.front()},
              {"mrays_per_second", spread(rates)},
              {"pages_read", stats_.pages_read - before.pages_read},
              {"bytes_read", stats_.bytes_read - before.bytes_read},
              {"nodes_per_ray", static_cast<double>(stats_.nodes_visited) / count},
              {"triangles_per_ray", static_cast<double>(stats_.triangles_tested) / count}};
    if (embree_) {
      line["embree_mrays_per_second"] = spread(embree_rates);
      line["embree_ratio"] = spread(ratios);
      line["different_from_embree"] = count_different(ours_, theirs_);
    }
    return line;
  }

  // What holds for all lines.
  [[nodiscard]] json about() const {
    json object{{"store", options_.store},
                {"triangles", info_.triangles},
                {"decoded_bytes", info_.decoded_bytes},
                {"memory_bytes", options_.service.memory},
                {"threads", options_.service.thread_count()},
                {"mode", std::string(to_string(options_.mode))},
                {"isa", stats_.isa},
                {"io", stats_.io}};
    if (!embree_) {
      object["peak_rss_bytes"] = with_peak(stats_, options_.service).peak_rss_bytes;
    }
    return object;
  }

  [[nodiscard]] Status finish() const {
    return write_stats(options_.service, open_, with_peak(stats_, options_.service),
                       {.open_seconds = open_.open_seconds});
  }

 private:
  Status make(RayKind kind) {
    const RayOrder order{.kind = kind, .count = options_.count, .seed = options_.seed};
    const std::uint64_t shuffle_seed = mix(options_.seed, kOrderSalt);
    std::uint64_t made = 0;
    RunStats stats;
    RAYMILL_RETURN_IF_ERROR(RayMaker(order, info_, camera_)
                                .make(
                                    *open_.store, buffer_,
                                    [&](std::span<const Ray> rays) -> Status {
                                      for (const Ray& ray : rays) {
                                        rays_[options_.shuffle ? permute(made, order.count, shuffle_seed) : made] = ray;
                                        ++made;
                                      }
                                      return {};
                                    },
                                    [&](double share, std::uint64_t rays, std::uint64_t bytes_read) {
                                      progress_.report("rays", share, rays, "rays", bytes_read);
                                    },
                                    stats));
    if (stats.total().rays > 0) {
      stats_ = stats.total();
    }
    return {};
  }

  // Traces rays_ once; returns the seconds from the first push to the last hit.
  Result<double> trace(RayKind kind) {
    const Query query = query_of(kind);
    const TraceConfig config{.query = query,
                             .mode = options_.mode,
                             .fields = query == Query::any ? Field::t : kDefaultClosestFields,
                             .relative = true};
    RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, open_.store->trace(config));
    std::size_t row = 0;
    BatchTimes times;
    const auto begin = std::chrono::steady_clock::now();
    RAYMILL_RETURN_IF_ERROR(run_batch(
        *job, source_of(rays_),
        [&](const HitChunk& chunk) -> Status {
          for (std::size_t i = 0; i < chunk.size(); ++i) {
            ours_[row++] = chunk.hit(i).t;
          }
          return {};
        },
        [&](const JobProgress& state) {
          progress_.report(to_string(kind), static_cast<double>(state.rays_done) / static_cast<double>(rays_.size()),
                           state.rays_done, "rays", state.bytes_read);
        },
        times));
    const double seconds = seconds_since(begin);
    stats_ = job->stats();
    return seconds;
  }

  const BenchOptions& options_;
  Progress progress_;
  std::vector<Ray> rays_, buffer_;
  std::vector<float> ours_, theirs_;
  OpenStore open_;
  StoreInfo info_;
  Camera camera_;
  std::optional<EmbreeScene> embree_;
  JobStats stats_;  // of the last job; what is read counts from the store's opening
};

std::string head_text(bool embree) {
  char text[160];
  std::snprintf(text, sizeof text, "%-24s %10s %10s %10s %8s %10s %10s%s\n", "rays", "Mrays/s", "least", "most", "hits",
                "pages", "MiB read", embree ? "     Embree      ratio  different" : "");
  return text;
}

std::string line_text(const json& line) {
  char text[200];
  const auto& rate = line["mrays_per_second"];
  int length =
      std::snprintf(text, sizeof text, "%-24s %10.3f %10.3f %10.3f %7.1f%% %10llu %10.1f",
                    line["name"].get<std::string>().c_str(), rate["median"].get<double>(), rate["least"].get<double>(),
                    rate["most"].get<double>(), 100 * line["hits"].get<double>() / line["rays"].get<double>(),
                    line["pages_read"].get<unsigned long long>(), line["bytes_read"].get<double>() / 0x1p20);
  if (line.contains("embree_ratio")) {
    std::snprintf(text + length, sizeof text - static_cast<std::size_t>(length), " %10.3f %10.3f %10llu",
                  line["embree_mrays_per_second"]["median"].get<double>(), line["embree_ratio"]["median"].get<double>(),
                  line["different_from_embree"].get<unsigned long long>());
  }
  return std::string(text) + "\n";
}

Status check(const BenchOptions& options) {
  if (options.count == 0 || options.count > kMostRays) {
    return {ErrorCode::invalid_argument, "--count goes from 1 to 2^32"};
  }
  if (options.embree && !options.service.server.empty()) {
    return {ErrorCode::invalid_argument, "--embree traces the store's triangles here; leave out --server"};
  }
  const std::uint64_t held = options.count * (sizeof(Ray) + sizeof(float) * (options.embree ? 2 : 1));
  if (options.service.server.empty() && held > options.service.memory / 2) {
    return {ErrorCode::budget_exceeded, std::to_string(options.count) + " rays are held in memory at once and take " +
                                            std::to_string(held >> 20) +
                                            " MiB, more than half of --memory; raise it or lower --count"};
  }
  return {};
}

// Lines are printed as they come; as JSON each is one line, and the first one says what holds for all.
Status run(const BenchOptions& options) {
  RAYMILL_RETURN_IF_ERROR(check(options));
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  Bench bench(options, style);
  RAYMILL_RETURN_IF_ERROR(bench.open());
  if (!options.json) {
    RAYMILL_RETURN_IF_ERROR(print(head_text(options.embree)));
  }
  for (const RayKind kind : options.kinds) {
    RAYMILL_ASSIGN_OR_RETURN(json line, bench.run(kind));
    if (options.json) {
      line["run"] = bench.about();
      RAYMILL_RETURN_IF_ERROR(print(line.dump() + "\n"));
    } else {
      RAYMILL_RETURN_IF_ERROR(print(line_text(line)));
    }
  }
  return bench.finish();
}

}  // namespace

Verb add_bench(CLI::App& app) {
  const auto options = std::make_shared<BenchOptions>();
  CLI::App* verb = app.add_subcommand("bench", "Measure how fast a store is traced here");
  verb->footer(
      "\nMakes rays of each kind (see 'raymill rays --help'; ao and shadow rays ask for any hit, the others for the "
      "closest)\n"
      "in memory and traces them --repeat times under --memory, by the clock on the wall from the first ray to the "
      "last\n"
      "hit. The first repetition finds no page in memory, later ones what is left of the one before. With --embree "
      "the\n"
      "same rays run by rtcIntersect1 or rtcOccluded1 on the store's triangles in turn, on as many threads; Embree's\n"
      "memory is not under the limit.\n\n"
      "  raymill bench city.mill --memory 512M --embree\n"
      "  raymill bench city.mill --kinds bounce --shuffle --count 10M --memory 128M --json");
  verb->add_option("STORE", options->store, "The store; with --server its name there")->required()->type_name("X.mill");
  add_parsed(*verb, "--kinds", options->kinds, parse_kinds,
             "Which rays, separated by commas. Default primary,bounce,shadow,ao,random", "LIST");
  add_parsed(*verb, "--count", options->count, parse_count, "Rays of each kind; 36 bytes each. Default 1M", "N");
  verb->add_option("--repeat", options->repeat, "How often")
      ->type_name("N")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  verb->add_flag("--shuffle", options->shuffle, "Trace them in a random order");
  verb->add_option("--seed", options->seed, "Another seed, other rays")->type_name("N")->capture_default_str();
  verb->add_option("--camera", options->camera, "As for render")->type_name("CAMERA");
  add_parsed(*verb, "--mode", options->mode, parse_mode,
             "watertight (default) or exact (beside Embree's robust mode), or fast (beside its default mode)", "MODE");
  verb->add_flag("--embree", options->embree, "Set Embree beside it");
  options->service.add_to(*verb);
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
