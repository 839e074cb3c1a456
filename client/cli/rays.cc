// rays: batches for tests and benchmarks.

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/cli/camera.h"
#include "client/cli/options.h"
#include "client/cli/random.h"
#include "client/cli/ray_file.h"
#include "client/cli/ray_maker.h"
#include "client/cli/verbs.h"

namespace raymill::client {

namespace {

struct RaysOptions {
  std::string store;
  std::string output;
  RayOrder order;
  std::string camera;
  bool shuffle = false;
  ServiceOptions service;
  std::string progress;
  bool json = false;
};

constexpr std::uint64_t kMaxCount = std::uint64_t{1} << 40;

constexpr std::uint64_t kShuffleSalt = 4;  // other draws than those of ray_maker.cc

Status run(const RaysOptions& options) {
  if (options.order.count == 0) {
    return {ErrorCode::invalid_argument, "--count must be at least 1"};
  }
  if (options.order.count > kMaxCount) {
    return {ErrorCode::invalid_argument, "--count goes up to 2^40"};
  }
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  const std::uint64_t shuffle_seed = mix(options.order.seed, kShuffleSalt);
  RAYMILL_ASSIGN_OR_RETURN(auto writer, RayFileWriter::create(options.output, options.order.count,
                                                              options.shuffle ? &shuffle_seed : nullptr));
  std::vector<Ray> buffer(buffer_rays(options.service.memory));
  RAYMILL_ASSIGN_OR_RETURN(const OpenStore open, open_store(options.service, options.store, options.output));
  RAYMILL_ASSIGN_OR_RETURN(StoreInfo info, open.store->info());
  RAYMILL_ASSIGN_OR_RETURN(const Camera camera, choose_camera(options.camera, info, picture_of(options.order.count)));
  info.metadata_json = std::string();  // can be large, and is not needed any more
  RAYMILL_RETURN_IF_ERROR(writer.set_origin(info.origin));
  const RayMaker maker(options.order, info, camera);
  std::optional<Progress> progress(style);
  RunStats stats;
  RAYMILL_RETURN_IF_ERROR(maker.make(
      *open.store, buffer, [&](std::span<const Ray> rays) { return writer.append(rays); },
      [&](double share, std::uint64_t rays, std::uint64_t bytes_read) {
        progress->report("rays", share, rays, "rays", bytes_read);
      },
      stats));
  RAYMILL_RETURN_IF_ERROR(writer.commit());
  progress.reset();
  RAYMILL_RETURN_IF_ERROR(write_stats(options.service, open, with_peak(stats.total(), options.service),
                                      {.open_seconds = open.open_seconds}));
  return options.json ? print_json({{"output", options.output}, {"rays", options.order.count}})
                      : print(options.output + ": " + std::to_string(options.order.count) + " rays\n");
}

}  // namespace

Verb add_rays(CLI::App& app) {
  const auto options = std::make_shared<RaysOptions>();
  CLI::App* verb = app.add_subcommand("rays", "Make a batch of rays for a store");
  verb->footer(
      "\nKinds: primary (a camera's, row by row), ao (from the primary hits, cosine-weighted, tfar the radius), "
      "bounce\n"
      "(the same without an end), shadow (from the primary hits to a light above, tfar 1), random (segments between\n"
      "two uniform points of the bounds, tfar 1). Origins of ao, bounce and shadow lie off the surface by 2^-18 of "
      "the\n"
      "largest coordinate or distance they come from. (N, 8) float32, or float64 where the store has an origin; the "
      "same\n"
      "seed gives the same rays. They begin at float32 numbers of the store's space: where parts have origins of "
      "their\n"
      "own, as coarsely as float32 is there (half a unit at 10^7); write rays of float64 of your own to see more.\n\n"
      "  raymill rays city.mill --kind bounce --count 10M -o bounce.npy --shuffle");
  verb->add_option("STORE", options->store, "The store")->required()->type_name("X.mill");
  add_parsed(*verb, "--kind", options->order.kind, parse_ray_kind, "primary, ao, bounce, random or shadow", "KIND")
      ->required();
  add_parsed(*verb, "--count", options->order.count, parse_count, "How many; k, M and G are powers of 1000", "N")
      ->required();
  verb->add_option("-o,--output", options->output, "The rays to write")->required()->type_name("RAYS.npy");
  verb->add_option("--seed", options->order.seed, "Another seed, other rays")->type_name("N")->capture_default_str();
  verb->add_option("--camera", options->camera, "As for render")->type_name("CAMERA");
  verb->add_option("--radius", options->order.radius,
                   "Reach of ao rays, scene units. Default: a tenth of the bounds' diagonal")
      ->type_name("LENGTH")
      ->check(CLI::PositiveNumber);
  verb->add_flag("--shuffle", options->shuffle, "Write them in a random order");
  options->service.add_to(*verb);
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
