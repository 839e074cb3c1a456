#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/camera.h"
#include "client/cli/options.h"
#include "client/cli/render/picture.h"
#include "client/cli/render/renderer.h"
#include "client/cli/verbs.h"
#include "storage/base/quotes.h"

namespace raymill::client {

namespace {

Result<View> parse_view(std::string_view name) {
  if (name == "depth") return View::depth;
  if (name == "normal") return View::normal;
  if (name == "ao") return View::ao;
  if (name == "path") return View::path;
  return Status(ErrorCode::invalid_argument, in_quotes(name) + " is not a view; depth, normal, ao and path are");
}

constexpr std::uint32_t kDefaultSpp = 16;

struct RenderOptions {
  std::string store;
  std::string output;
  std::string camera;
  RenderConfig render{.extent = {.width = 1280, .height = 720}};
  std::optional<std::uint32_t> spp;
  double radius = 0;
  ServiceOptions service;
  std::string progress;
  bool json = false;
};

Tone tone_of(View view) {
  switch (view) {
    case View::depth:
      return Tone::distance;
    case View::normal:
      return Tone::direction;
    case View::ao:
      return Tone::linear;
    case View::path:
      break;
  }
  return Tone::radiance;
}

float default_radius(const StoreInfo& info) {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double side = std::max(0.0, double(info.bounds_max[axis]) - info.bounds_min[axis]);
    sum += side * side;
  }
  return static_cast<float>(0.1 * std::sqrt(sum));
}

// Shares of the budget for the picture and the waves, tried in turn; the rest is for pages and rays in flight.
constexpr std::uint64_t kShares[] = {16, 64, 256, 1024};

struct Stage {
  std::unique_ptr<Renderer> renderer;
  OpenStore open;
};

// The renderer takes its memory before the engine is made. Where the store then does not fit, a smaller share may do.
Result<Stage> set_stage(const RenderOptions& options) {
  RenderConfig config = options.render;
  Status refused;
  for (const std::uint64_t share : kShares) {
    config.memory_bytes = options.service.memory / share;
    if (Renderer::least_memory_bytes(config) > options.service.memory / 2) {
      return Status(ErrorCode::budget_exceeded, "a picture of this size needs at least " +
                                                    storage::format_bytes(2 * Renderer::least_memory_bytes(config)) +
                                                    ", " + storage::format_bytes(options.service.memory) +
                                                    " given; raise --memory");
    }
    auto renderer = std::make_unique<Renderer>(config);
    auto open = open_store(options.service, options.store, options.output);
    if (open) {
      return Stage{std::move(renderer), std::move(*open)};
    }
    refused = open.status();
    if (refused.code() != ErrorCode::budget_exceeded) {
      break;
    }
  }
  return refused;
}

Status run(RenderOptions& options) {
  RenderConfig& config = options.render;
  const bool is_sampled = config.view == View::ao || config.view == View::path;
  if (options.spp && !is_sampled) {
    return {ErrorCode::invalid_argument, "--spp is for --view ao and path; depth and normal take one ray a pixel"};
  }
  if (config.fog_density > 0 && !is_sampled) {
    return {ErrorCode::invalid_argument, "--fog is for --view ao and path; depth and normal show surfaces alone"};
  }
  config.spp = options.spp.value_or(is_sampled ? kDefaultSpp : 1);
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  RAYMILL_ASSIGN_OR_RETURN(
      auto picture, Picture::create(options.output, config.extent, channels_of(config.view), tone_of(config.view)));
  RAYMILL_ASSIGN_OR_RETURN(Stage stage, set_stage(options));
  const OpenStore& open = stage.open;
  Renderer& renderer = *stage.renderer;
  {
    RAYMILL_ASSIGN_OR_RETURN(const StoreInfo info, open.store->info());
    RAYMILL_ASSIGN_OR_RETURN(const Camera camera, choose_camera(options.camera, info, config.extent));
    renderer.set_camera(camera);
    renderer.set_ao_radius(options.radius > 0 ? static_cast<float>(options.radius) : default_radius(info));
  }
  std::optional<Progress> progress(style);
  RAYMILL_RETURN_IF_ERROR(renderer.render(
      *open.store, [&](std::span<const float> rows) { return picture.append(rows); },
      [&](double fraction, std::uint64_t rays) { progress->report("render", fraction, rays, "rays"); }));
  const auto output_begin = std::chrono::steady_clock::now();
  RAYMILL_RETURN_IF_ERROR(picture.commit());
  const double output_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - output_begin).count();
  progress.reset();
  const JobStats stats = with_peak(renderer.stats(), options.service);
  const RunTimes times{.open_seconds = open.open_seconds, .output_seconds = output_seconds};
  RAYMILL_RETURN_IF_ERROR(write_stats(options.service, open, stats, times));
  return options.json ? print_json(stats_json(stats, times, options.service.memory, options.service.thread_count()))
                      : print(stats_text(stats));
}

}  // namespace

Verb add_render(CLI::App& app) {
  const auto options = std::make_shared<RenderOptions>();
  CLI::App* verb = app.add_subcommand("render", "Make a picture");
  verb->footer(
      "\nViews: depth (distance in scene units, channel Z), normal (world space, in RGB), ao (open share of the "
      "hemisphere\n"
      "within --radius, channel Y), path (grey diffuse surfaces under a sky and a sun). .exr keeps float32 values, "
      ".png is\n"
      "8-bit sRGB (depth by its logarithm, path by a filmic curve). The same seed gives the same picture, whatever "
      "the\n"
      "memory and the threads. A picture is kept in a raw file beside its name while it is made. Rays\n"
      "begin at float32 numbers of the store's space, coarse in parts that have origins of their own.\n\n"
      "  raymill render city.mill -o city.png --view path --spp 64 --camera overview");
  verb->add_option("STORE", options->store, "The store; with --server its name there")->required()->type_name("X.mill");
  verb->add_option("-o,--output", options->output, "The picture to write: .exr or .png")->required()->type_name("FILE");
  verb->add_option("--camera", options->camera,
                   "A camera of the scene by name or index, 'frame' (all of the scene from above), or "
                   "ox,oy,oz,lx,ly,lz[,fov]: position, point looked at, vertical degrees (40). Left out: the scene's "
                   "first camera, else frame")
      ->type_name("CAMERA");
  add_parsed(*verb, "--view", options->render.view, parse_view, "depth (default), normal, ao or path", "VIEW");
  verb->add_option("--spp", options->spp, "Samples a pixel for ao and path. Default 16")
      ->type_name("N")
      ->check(CLI::Range(1, 65536));
  add_parsed(*verb, "--size", options->render.extent, parse_extent, "Pixels. Default 1280x720", "WxH");
  verb->add_option("--bounces", options->render.bounces, "Diffuse bounces for path")
      ->type_name("N")
      ->check(CLI::Range(0, 64))
      ->capture_default_str();
  verb->add_option("--radius", options->radius, "Reach of ao, scene units. Default: a tenth of the bounds' diagonal")
      ->type_name("LENGTH")
      ->check(CLI::PositiveNumber);
  verb->add_option("--fog", options->render.fog_density,
                   "Show the store's fog in ao and path, as a grey veil before what the camera sees: its extinction in "
                   "1 / scene unit where a voxel holds 1. Fog casts no shadow")
      ->type_name("X")
      ->check(CLI::PositiveNumber);
  verb->add_option("--seed", options->render.seed, "Another seed, other noise")->type_name("N")->capture_default_str();
  add_parsed(*verb, "--mode", options->render.mode, parse_mode, "watertight (default), fast or exact", "MODE");
  options->service.add_to(*verb);
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
