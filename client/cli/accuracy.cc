// accuracy: what each mode, on each store of a scene, costs and what its answers are worth.
//
//   rays: a file, or made and kept in a temporary one ---+--> job of one store and mode --> hits in the rays' order
//                                                        |                                        |
//   mode exact on the first store --> truth, a temporary file of 16 bytes a ray -----> Tally <----+
//
// Nothing but buffers is held, whatever the number of rays. A store is opened anew for each mode, so that what is read
// is what a run from nothing reads; then rounds of all modes in turn give the rates.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/cli/accuracy/plot.h"
#include "client/cli/accuracy/row_file.h"
#include "client/cli/accuracy/settings.h"
#include "client/cli/accuracy/tally.h"
#include "client/cli/batch.h"
#include "client/cli/camera.h"
#include "client/cli/options.h"
#include "client/cli/ray_file.h"
#include "client/cli/ray_maker.h"
#include "client/cli/render/picture.h"
#include "client/cli/verbs.h"

namespace raymill::client {

namespace {

struct AccuracyOptions {
  std::vector<std::string> stores;
  std::string rays;  ///< empty: made
  RayOrder order{.kind = RayKind::primary, .count = 1'000'000};
  std::string camera;
  unsigned rounds = 3;
  bool closed = false;
  std::optional<double> tolerance;
  double wrong_share = 0;
  std::vector<double> tolerances, tolerance_angles;
  std::string plot;
  ServiceOptions service;
  std::string progress;
  bool json = false;
};

constexpr std::uint64_t kMostMadeRays = std::uint64_t{1} << 40;
// The oracle first: the others are compared with it. Printed the other way round.
constexpr std::array<Mode, 3> kModes = {Mode::exact, Mode::watertight, Mode::fast};
constexpr std::size_t kReadRays = 4096;

/// The batch, from its beginning again and again. Thread-confined.
class RayReader {
 public:
  explicit RayReader(const RowFile<Ray>& made) : made_(made) {}
  explicit RayReader(RayFileReader file) : file_(std::move(file)), buffer_(kReadRays) {}

  /// Of a file's rays; those that were made are relative to it already.
  void set_origin(const std::array<double, 3>& origin) {
    if (file_) {
      file_->set_origin(origin);
    }
  }
  void rewind() {
    if (made_) {
      made_->rewind();
    } else {
      file_->rewind();
    }
  }
  /// At most kReadRays and at most `most`, valid until the next call; none at the end.
  Result<std::span<const Ray>> next(std::size_t most = kReadRays) {
    if (made_) {
      return made_->next(most);
    }
    const auto wanted = std::span(buffer_).first(std::min(most, buffer_.size()));
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, file_->read(wanted));
    return std::span<const Ray>(wanted).first(count);
  }

 private:
  std::optional<RowFile<Ray>::Reader> made_;
  std::optional<RayFileReader> file_;
  std::vector<Ray> buffer_;
};

// How a store is asked: in every mode, and where it has proxies, in those that approximate, within each tolerance.
std::vector<Manner> manners_of(const StoreInfo& info, const AccuracyOptions& options) {
  std::vector<Manner> manners;
  for (const Mode mode : kModes) {
    manners.push_back({mode, 0, 0});
  }
  if (std::find(info.features.begin(), info.features.end(), "proxies") == info.features.end()) {
    return manners;
  }
  for (const Mode mode : {Mode::fast, Mode::watertight}) {
    for (const double length : options.tolerances) {
      manners.push_back({mode, length, 0});
    }
    for (const double angle : options.tolerance_angles) {
      manners.push_back({mode, 0, angle});
    }
  }
  return manners;
}

class Accuracy {
 public:
  Accuracy(const AccuracyOptions& options, ProgressStyle style)
      : options_(options),
        progress_(style),
        folder_(folder_for_temporaries(options.service, options.plot)),
        made_(folder_, "rays"),
        truth_(folder_, "the oracle's hits") {}

  Status run() {
    RAYMILL_RETURN_IF_ERROR(options_.rays.empty() ? make_rays() : open_rays());
    for (const std::string& store : options_.stores) {
      RAYMILL_RETURN_IF_ERROR(measure(store));
    }
    progress_.reset();
    return has_tolerances() == asks_tolerances() ? Status()
                                                 : Status(ErrorCode::invalid_argument,
                                                          "none of the stores holds proxies, which --tolerances and "
                                                          "--tolerance-angles need; build one with --proxies");
  }

  [[nodiscard]] const std::vector<Setting>& settings() const { return settings_; }
  // What holds for all settings.
  [[nodiscard]] nlohmann::json about() const {
    nlohmann::json rays{{"count", count_},
                        {"invalid", settings_[0].answers.invalid},
                        {"oracle_hits", settings_[0].answers.oracle_hits}};
    if (options_.rays.empty()) {
      rays["kind"] = std::string(to_string(options_.order.kind));
      rays["seed"] = options_.order.seed;
    } else {
      rays["file"] = options_.rays;
    }
    nlohmann::json object{{"oracle", {{"store", options_.stores[0]}, {"mode", "exact"}}},
                          {"rays", std::move(rays)},
                          {"rounds", options_.rounds},
                          {"memory_bytes", options_.service.memory},
                          {"threads", options_.service.thread_count()},
                          {"isa", stats_.isa},
                          {"io", stats_.io}};
    if (options_.service.server.empty()) {
      object["peak_rss_bytes"] = with_peak(stats_, options_.service).peak_rss_bytes;
    }
    return object;
  }

 private:
  [[nodiscard]] bool asks_tolerances() const {
    return !options_.tolerances.empty() || !options_.tolerance_angles.empty();
  }
  [[nodiscard]] bool has_tolerances() const {
    return std::any_of(settings_.begin(), settings_.end(),
                       [](const Setting& setting) { return setting.manner.approximates(); });
  }

  Status open_rays() {
    for (std::optional<RayReader>* reader : {&pushed_, &seen_}) {
      RAYMILL_ASSIGN_OR_RETURN(RayFileReader file, RayFileReader::open(options_.rays));
      count_ = file.count();
      reader->emplace(std::move(file));
    }
    return count_ > 0 ? Status() : Status(ErrorCode::bad_rays, options_.rays + ": holds no rays");
  }

  // For the first store, as the verb rays makes them.
  Status make_rays() {
    std::vector<Ray> buffer(buffer_rays(options_.service.memory));
    RAYMILL_ASSIGN_OR_RETURN(const OpenStore open, open_store(options_.service, options_.stores[0], options_.plot));
    RAYMILL_ASSIGN_OR_RETURN(StoreInfo info, open.store->info());
    RAYMILL_ASSIGN_OR_RETURN(const Camera camera,
                             choose_camera(options_.camera, info, picture_of(options_.order.count)));
    info.metadata_json = std::string();  // can be large, and is not needed any more
    RunStats stats;
    const RayMaker::Sink keep = [this](std::span<const Ray> rays) -> Status {
      for (const Ray& ray : rays) {
        RAYMILL_RETURN_IF_ERROR(made_.append(ray));
      }
      return {};
    };
    const RayMaker::Observer tell = [this](double share, std::uint64_t rays, std::uint64_t bytes_read) {
      progress_->report("rays", share, rays, "rays", bytes_read);
    };
    const RayMaker maker(options_.order, info, camera);
    RAYMILL_RETURN_IF_ERROR(maker.make(*open.store, buffer, keep, tell, stats));
    RAYMILL_RETURN_IF_ERROR(made_.finish());
    count_ = made_.count();
    pushed_.emplace(made_);
    seen_.emplace(made_);
    return {};
  }

  // All settings of one store.
  Status measure(const std::string& store) {
    const std::size_t first = settings_.size();
    inside_.emplace(folder_, "rays inside");
    OpenStore open;
    std::vector<Manner> manners{{kModes[0], 0, 0}};
    for (std::size_t i = 0; i < manners.size(); ++i) {
      open = {};  // its memory is free before the next one asks for it
      RAYMILL_ASSIGN_OR_RETURN(open, open_store(options_.service, store, options_.plot));
      RAYMILL_ASSIGN_OR_RETURN(const StoreInfo info, open.store->info());
      RAYMILL_RETURN_IF_ERROR(same_scene(info));
      manners = manners_of(info, options_);
      Setting& setting = settings_.emplace_back();
      setting.store = store;
      setting.positions = info.positions;
      setting.manner = manners[i];
      setting.triangles = info.triangles;
      setting.store_bytes = info.store_bytes;
      setting.decoded_bytes = info.decoded_bytes;
      RAYMILL_RETURN_IF_ERROR(judge(*open.store, setting));
    }
    for (unsigned round = 0; round < options_.rounds; ++round) {
      for (std::size_t i = first; i < settings_.size(); ++i) {
        RAYMILL_RETURN_IF_ERROR(time(*open.store, settings_[i]));
      }
    }
    for (std::size_t i = first; i < settings_.size(); ++i) {
      std::sort(settings_[i].mega_rays_per_second.begin(), settings_[i].mega_rays_per_second.end());
    }
    const auto begin = settings_.begin() + static_cast<std::ptrdiff_t>(first);
    std::reverse(begin, begin + static_cast<std::ptrdiff_t>(kModes.size()));
    return {};
  }

  // Ids are compared, so the stores must number the same geometries; and rays, so they must lie alike.
  Status same_scene(const StoreInfo& info) {
    if (settings_.empty()) {
      geometries_ = info.geometries;
      origin_ = info.origin;
      pushed_->set_origin(origin_);
      seen_->set_origin(origin_);
    }
    if (info.origin != origin_) {
      return {ErrorCode::invalid_argument,
              info.name + " has another origin than " + options_.stores[0] + "; build both with the same --origin"};
    }
    if (info.geometries == geometries_) {
      return {};
    }
    return {ErrorCode::invalid_argument, info.name + " holds " + std::to_string(info.geometries) + " geometries, " +
                                             options_.stores[0] + " " + std::to_string(geometries_) +
                                             "; name stores of one scene"};
  }

  // Compares the mode's hits with the oracle's; mode exact of the first store is the oracle.
  Status judge(Store& store, Setting& setting) {
    const Manner& manner = setting.manner;
    const bool is_truth = settings_.size() == 1, is_own_oracle = manner.mode == Mode::exact && options_.closed;
    Field fields = Field::t | Field::ids | (is_own_oracle ? Field::uv | Field::normal : Field::none);
    fields = fields | (manner.approximates() ? Field::uv : Field::none);  // which tell a proxy's hits
    Tally tally;
    RowFile<Truth>::Reader truths(truth_);
    RowFile<std::uint8_t>::Reader insides(*inside_);
    seen_->rewind();
    const auto sink = [&](const HitChunk& chunk) -> Status {
      for (std::size_t row = 0; row < chunk.size();) {
        RAYMILL_ASSIGN_OR_RETURN(const auto rays, seen_->next(chunk.size() - row));
        for (const Ray& ray : rays) {
          const Hit hit = chunk.hit(row++);
          std::uint8_t is_inside = is_own_oracle && begins_inside(ray, hit) ? 1 : 0;
          Truth truth = truth_of(ray, hit);
          if (is_own_oracle) {
            RAYMILL_RETURN_IF_ERROR(inside_->append(is_inside));
          } else if (options_.closed) {
            RAYMILL_ASSIGN_OR_RETURN(const auto one, insides.next(1));
            is_inside = one[0];
          }
          if (is_truth) {
            RAYMILL_RETURN_IF_ERROR(truth_.append(truth));
          } else {
            RAYMILL_ASSIGN_OR_RETURN(const auto one, truths.next(1));
            truth = one[0];
          }
          tally.add(truth, hit, is_inside != 0, manner.bound(truth));
        }
      }
      return {};
    };
    RAYMILL_ASSIGN_OR_RETURN(const JobStats stats, trace(store, config_of(manner, fields), sink));
    RAYMILL_RETURN_IF_ERROR(is_truth ? truth_.finish() : Status());
    RAYMILL_RETURN_IF_ERROR(is_own_oracle ? inside_->finish() : Status());
    setting.bytes_read = stats.bytes_read - bytes_before_;
    setting.answers = answer_figures(tally);
    return {};
  }

  Status time(Store& store, Setting& setting) {
    const auto drop = [](const HitChunk&) { return Status(); };
    RAYMILL_ASSIGN_OR_RETURN(const JobStats stats,
                             trace(store, config_of(setting.manner, Field::t | Field::ids), drop));
    setting.mega_rays_per_second.push_back(static_cast<double>(count_) / 1e6 / std::max(stats.trace_seconds, 1e-9));
    return {};
  }

  static TraceConfig config_of(const Manner& manner, Field fields) {
    TraceConfig config{.mode = manner.mode, .fields = fields, .relative = true};
    config.tolerance = manner.tolerance;
    config.tolerance_angle = manner.tolerance_angle;
    return config;
  }

  Result<JobStats> trace(Store& store, const TraceConfig& config, const HitSink& sink) {
    RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, store.trace(config));
    bytes_before_ = job->progress().bytes_read;
    pushed_->rewind();
    BatchTimes times;
    RAYMILL_RETURN_IF_ERROR(run_batch(
        *job, [this] { return pushed_->next(); }, sink,
        [&](const JobProgress& state) {
          progress_->report(to_string(config.mode), static_cast<double>(state.rays_done) / static_cast<double>(count_),
                            state.rays_done, "rays", state.bytes_read);
        },
        times));
    stats_ = job->stats();
    return stats_;
  }

  const AccuracyOptions& options_;
  std::optional<Progress> progress_;
  std::string folder_;  // of the temporary files
  RowFile<Ray> made_;
  RowFile<Truth> truth_;
  std::optional<RowFile<std::uint8_t>> inside_;  // whether a ray began inside, by the store's own oracle
  std::optional<RayReader> pushed_, seen_;       // by the thread that pushes, and by the one that looks at hits
  std::uint64_t count_ = 0;
  std::uint64_t geometries_ = 0;
  std::array<double, 3> origin_{};
  std::uint64_t bytes_before_ = 0;
  std::vector<Setting> settings_;
  JobStats stats_;  // of the last job
};

Status write_plot(std::span<const Setting> settings, Picture& picture) {
  std::vector<PlotPoint> points;
  for (const Setting& setting : settings) {
    points.push_back({.label = manner_text(setting.manner) + " " + setting.positions,
                      .rate = setting.rate(),
                      .error = setting.answers.t_units.most,
                      .is_sound = setting.wrong_answers() == 0});
  }
  for (const std::size_t i : pareto_front(settings)) {
    points[i].is_on_front = true;
  }
  const std::vector<Ink> pixels = draw_plot(points);
  std::vector<float> row;
  for (std::size_t begin = 0; begin < pixels.size(); begin += kPlotExtent.width) {
    row.clear();
    for (const Ink ink : std::span(pixels).subspan(begin, kPlotExtent.width)) {
      const auto colour = colour_of(ink);
      row.insert(row.end(), colour.begin(), colour.end());
    }
    RAYMILL_RETURN_IF_ERROR(picture.append(row));
  }
  return picture.commit();
}

Status check(const AccuracyOptions& options) {
  if (options.rays.empty() && (options.order.count == 0 || options.order.count > kMostMadeRays)) {
    return {ErrorCode::invalid_argument, "--count goes from 1 to 2^40"};
  }
  return {};
}

Status run(const AccuracyOptions& options) {
  RAYMILL_RETURN_IF_ERROR(check(options));
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  std::optional<Picture> picture;
  if (!options.plot.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(Picture empty, Picture::create(options.plot, kPlotExtent, 3, Tone::linear));
    picture.emplace(std::move(empty));
  }
  Accuracy accuracy(options, style);
  RAYMILL_RETURN_IF_ERROR(accuracy.run());
  const std::vector<Setting>& settings = accuracy.settings();
  if (picture) {
    RAYMILL_RETURN_IF_ERROR(write_plot(settings, *picture));
  }
  if (!options.json) {
    return print(
        settings_text(settings, options.closed) +
        (options.tolerance ? choice_text(settings, {*options.tolerance, options.wrong_share}) : std::string()));
  }
  nlohmann::json object = accuracy.about();
  object["settings"] = nlohmann::json::array();
  for (const Setting& setting : settings) {
    object["settings"].push_back(setting_json(setting));
  }
  if (options.tolerance) {
    const Setting* best = fastest_within(settings, {*options.tolerance, options.wrong_share});
    object["tolerance"] = *options.tolerance;
    object["wrong_share"] = options.wrong_share;
    object["fastest_within"] = best == nullptr ? nlohmann::json()
                                               : nlohmann::json{{"store", best->store},
                                                                {"mode", std::string(to_string(best->manner.mode))},
                                                                {"tolerance", best->manner.tolerance},
                                                                {"tolerance_angle", best->manner.tolerance_angle}};
  }
  return print_json(object);
}

}  // namespace

Verb add_accuracy(CLI::App& app) {
  const auto options = std::make_shared<AccuracyOptions>();
  CLI::App* verb = app.add_subcommand("accuracy", "Measure what each mode costs and what its answers are worth");
  verb->footer(
      "\nTraces the rays for the closest hit in each mode on each store, and sets the hits beside those of mode exact "
      "on\n"
      "the first one: name stores of one scene, the finest positions first. A line tells\n"
      "  Mrays/s          the median of --rounds runs, in which the modes take turns\n"
      "  MiB read         pages that a run reads which finds none in memory\n"
      "  wrong hit/miss   part of the rays that hit where the oracle misses, or miss where it hits\n"
      "  another surface  of --tolerances: part of the rays that hit off by more than the tolerance, as a subtree was "
      "taken\n"
      "                   for hit that the ray passes, or the other way; no part of the error of t\n"
      "  by proxy         part of the rays whose hit stands for a subtree that was not read\n"
      "  wrong primitive  part of the rays that hit another primitive; at the same t it is not wrong\n"
      "  error of t       where both hit: steps between float32 numbers, and lengths\n"
      "With --tolerance it names the fastest line without a wrong hit or miss whose largest error of t is no larger.\n"
      "Rays that leave surfaces (ao, bounce, shadow) leave those of the first store, and meet anew what a lattice "
      "moves in\n"
      "their way.\n"
      "Rays and the oracle's hits wait in temporary files (48 bytes a ray), so there may be any number.\n\n"
      "  raymill accuracy city.mill --tolerance 1e-4\n"
      "  raymill accuracy city.mill city-16b.mill city-12b.mill --rays rays.npy --plot city.png --json");
  verb->add_option("STORE", options->stores, "The stores; with --server their names there")
      ->required()
      ->type_name("X.mill");
  CLI::Option* file = verb->add_option("--rays", options->rays, "The rays. Left out: they are made for the first store")
                          ->type_name("RAYS.npy");
  add_parsed(
      *verb, "--kind", options->order.kind, parse_ray_kind,
      "Of rays that are made: primary, ao, bounce, random or shadow, as 'raymill rays' makes them. Default primary",
      "KIND")
      ->excludes(file);
  add_parsed(*verb, "--count", options->order.count, parse_count, "How many are made. Default 1M", "N")->excludes(file);
  verb->add_option("--seed", options->order.seed, "Another seed, other rays")
      ->type_name("N")
      ->capture_default_str()
      ->excludes(file);
  verb->add_option("--camera", options->camera, "As for render")->type_name("CAMERA")->excludes(file);
  verb->add_option("--rounds", options->rounds, "How often rates are measured")
      ->type_name("N")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  add_parsed(*verb, "--tolerance", options->tolerance, parse_length,
             "Largest error of t that is allowed, in scene units: name the fastest setting that keeps it", "LENGTH");
  add_parsed(*verb, "--wrong-share", options->wrong_share, parse_length,
             "With --tolerance: part of the rays that may be a wrong hit or miss or hit another surface. Default 0",
             "SHARE");
  add_parsed(*verb, "--tolerances", options->tolerances, parse_lengths,
             "Trace stores with proxies ('raymill build --proxies') within each of these too, as 'raymill trace "
             "--tolerance' does: lengths separated by commas",
             "LIST");
  add_parsed(*verb, "--tolerance-angles", options->tolerance_angles, parse_lengths,
             "The same, as 'raymill trace --tolerance-angle' does", "LIST");
  verb->add_flag(
      "--closed", options->closed,
      "The scene's meshes are closed and their triangles face outwards: count leaks, misses of rays without "
      "an end that surely begin inside (by the store's own mode exact: they meet a triangle from behind, clear "
      "of its edges)");
  verb->add_option("--plot", options->plot, "Draw rate and largest error of t of each line to this picture")
      ->type_name("P.png");
  options->service.add_tracing_to(*verb);
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
