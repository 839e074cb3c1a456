// rays: batches for tests and benchmarks.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/cli/batch.h"
#include "client/cli/camera.h"
#include "client/cli/interrupt.h"
#include "client/cli/options.h"
#include "client/cli/ray_file.h"
#include "client/cli/sampling.h"
#include "client/cli/verbs.h"

namespace raymill::client {

namespace {

enum class Kind : std::uint8_t { primary, ao, bounce, random, shadow };

Result<Kind> parse_kind(std::string_view name) {
  if (name == "primary") return Kind::primary;
  if (name == "ao") return Kind::ao;
  if (name == "bounce") return Kind::bounce;
  if (name == "random") return Kind::random;
  if (name == "shadow") return Kind::shadow;
  return Status(ErrorCode::invalid_argument,
                "'" + std::string(name) + "' is not a kind of rays; primary, ao, bounce, random and shadow are");
}

struct Options {
  std::string store;
  std::string output;
  Kind kind = Kind::primary;
  std::uint64_t count = 0;
  std::uint64_t seed = 1;
  std::string camera;
  double radius = 0;
  bool shuffle = false;
  ServiceOptions service;
  std::string progress;
  bool json = false;
};

constexpr std::uint64_t kMaxCount = std::uint64_t{1} << 40;

// Salts that keep the draws of one place apart.
constexpr std::uint64_t kPixelSalt = 1, kHitSalt = 2, kSegmentSalt = 3, kShuffleSalt = 4;

double diagonal(const StoreInfo& info) {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double side = std::max(0.0, double(info.bounds_max[axis]) - info.bounds_min[axis]);
    sum += side * side;
  }
  return std::sqrt(sum);
}

// The most even 16:9 picture of at least `count` pixels.
Extent picture(std::uint64_t count) {
  const auto width = static_cast<std::uint32_t>(std::ceil(std::sqrt(static_cast<double>(count) * 16 / 9)));
  const auto height = static_cast<std::uint32_t>((count + width - 1) / width);
  return {std::max(1U, width), std::max(1U, height)};
}

class RayMaker {
 public:
  RayMaker(const Options& options, const StoreInfo& info, const Camera& camera)
      : options_(options), info_(info), camera_(camera), extent_(picture(options.count)), diagonal_(diagonal(info)) {}

  // The ray through pixel `index` of the first pass at its centre, of later ones at a place of its own.
  [[nodiscard]] Ray primary(std::uint64_t index, std::uint64_t pass) const {
    Random random(mix(options_.seed, mix(kPixelSalt, pass), index));
    const double dx = pass == 0 ? 0.5 : random.unit(), dy = pass == 0 ? 0.5 : random.unit();
    const std::uint64_t row = index / extent_.width;
    return camera_.ray(static_cast<double>(index % extent_.width) + dx, static_cast<double>(row) + dy, extent_);
  }

  // A segment between two points of the bounds: t = 1 is its end.
  [[nodiscard]] Ray segment(std::uint64_t index) const {
    Random random(mix(options_.seed, kSegmentSalt, index));
    Ray ray;
    for (int axis = 0; axis < 3; ++axis) {
      ray.org[axis] = random.range(info_.bounds_min[axis], info_.bounds_max[axis]);
    }
    for (int axis = 0; axis < 3; ++axis) {
      ray.dir[axis] = random.range(info_.bounds_min[axis], info_.bounds_max[axis]) - ray.org[axis];
    }
    ray.tfar = 1;
    return ray;
  }

  // What leaves the place where `ray` hit.
  [[nodiscard]] Ray secondary(const Ray& ray, const Hit& hit, std::uint64_t index, std::uint64_t pass) const {
    Random random(mix(options_.seed, mix(kHitSalt, pass), index));
    const Surface surface = surface_of(ray, hit);
    Ray next{.org = surface.origin};
    if (options_.kind == Kind::shadow) {
      // To a square light over the scene, a fifth of the diagonal wide; t = 1 is the light.
      for (int axis = 0; axis < 3; ++axis) {
        const double centre = 0.5 * (double(info_.bounds_min[axis]) + info_.bounds_max[axis]);
        const double above = axis == 1 ? 0.75 * diagonal_ : (random.unit() - 0.5) * 0.2 * diagonal_;
        next.dir[axis] = static_cast<float>(centre + above) - next.org[axis];
      }
      next.tfar = 1;
      return next;
    }
    next.dir = cosine_direction(surface.normal, random);
    if (options_.kind == Kind::ao) {
      next.tfar = static_cast<float>(options_.radius > 0 ? options_.radius : 0.1 * diagonal_);
    }
    return next;
  }

 private:
  const Options& options_;
  const StoreInfo& info_;
  const Camera& camera_;
  Extent extent_;
  double diagonal_;
};

// Rays that need no hit.
Status write_direct(const Options& options, const RayMaker& maker, RayFileWriter& writer, std::vector<Ray>& buffer,
                    Progress& progress) {
  while (writer.missing() > 0) {
    const std::uint64_t first = options.count - writer.missing();
    const auto step = static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), writer.missing()));
    for (std::size_t i = 0; i < step; ++i) {
      buffer[i] = options.kind == Kind::random ? maker.segment(first + i) : maker.primary(first + i, 0);
    }
    RAYMILL_RETURN_IF_ERROR(writer.append(std::span(buffer).first(step)));
    progress.report("rays", static_cast<double>(first + step) / static_cast<double>(options.count), first + step,
                    "rays");
    if (interrupted()) {
      return interrupted_status();
    }
  }
  return {};
}

// Rays that leave the hits of primary rays: passes over the picture until there are enough.
Status write_secondary(const Options& options, const RayMaker& maker, RayFileWriter& writer, std::vector<Ray>& buffer,
                       Store& store, Progress& progress, RunStats& stats) {
  const TraceConfig config{.fields = Field::t | Field::normal};
  for (std::uint64_t pass = 0; writer.missing() > 0; ++pass) {
    RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, store.trace(config));
    const std::uint64_t missing_before = writer.missing();
    std::uint64_t next = 0;
    BatchTimes times;
    const Status status = run_batch(
        *job,
        [&]() -> Result<std::span<const Ray>> {
          const auto step = static_cast<std::size_t>(std::min<std::uint64_t>(buffer.size(), options.count - next));
          for (std::size_t i = 0; i < step; ++i) {
            buffer[i] = maker.primary(next++, pass);
          }
          return std::span<const Ray>(buffer).first(step);
        },
        [&](const HitChunk& chunk) -> Status {
          for (std::size_t i = 0; i < chunk.size() && writer.missing() > 0; ++i) {
            const Hit hit = chunk.hit(i);
            if (std::isfinite(hit.t)) {
              const std::uint64_t index = chunk.first_ray() + i;
              const Ray ray = maker.secondary(maker.primary(index, pass), hit, index, pass);
              RAYMILL_RETURN_IF_ERROR(writer.append(std::span(&ray, 1)));
            }
          }
          return {};
        },
        [&](const JobProgress& state) {
          const double share = static_cast<double>(state.rays_done) / static_cast<double>(options.count);
          progress.report("rays", std::min(share, 1.0), state.rays_done, "rays", state.bytes_read);
        },
        times);
    RAYMILL_RETURN_IF_ERROR(status);
    stats.add(job->stats());
    if (writer.missing() == missing_before) {
      return {ErrorCode::invalid_argument, "the camera sees nothing of the scene; choose another with --camera"};
    }
  }
  return {};
}

Status run(const Options& options) {
  if (options.count == 0) {
    return {ErrorCode::invalid_argument, "--count must be at least 1"};
  }
  if (options.count > kMaxCount) {
    return {ErrorCode::invalid_argument, "--count goes up to 2^40"};
  }
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  const std::uint64_t shuffle_seed = mix(options.seed, kShuffleSalt);
  RAYMILL_ASSIGN_OR_RETURN(
      auto writer, RayFileWriter::create(options.output, options.count, options.shuffle ? &shuffle_seed : nullptr));
  std::vector<Ray> buffer(buffer_rays(options.service.memory));
  RAYMILL_ASSIGN_OR_RETURN(const OpenStore open, open_store(options.service, options.store, options.output));
  RAYMILL_ASSIGN_OR_RETURN(StoreInfo info, open.store->info());
  RAYMILL_ASSIGN_OR_RETURN(const Camera camera, choose_camera(options.camera, info, picture(options.count)));
  info.metadata_json = std::string();  // can be large, and is not needed any more
  const RayMaker maker(options, info, camera);
  std::optional<Progress> progress(style);
  RunStats stats;
  const bool is_direct = options.kind == Kind::primary || options.kind == Kind::random;
  RAYMILL_RETURN_IF_ERROR(is_direct ? write_direct(options, maker, writer, buffer, *progress)
                                    : write_secondary(options, maker, writer, buffer, *open.store, *progress, stats));
  RAYMILL_RETURN_IF_ERROR(writer.commit());
  progress.reset();
  RAYMILL_RETURN_IF_ERROR(write_stats(options.service, open, with_peak(stats.total(), options.service),
                                      {.open_seconds = open.open_seconds}));
  return options.json ? print_json({{"output", options.output}, {"rays", options.count}})
                      : print(options.output + ": " + std::to_string(options.count) + " rays\n");
}

}  // namespace

Verb add_rays(CLI::App& app) {
  const auto options = std::make_shared<Options>();
  CLI::App* verb = app.add_subcommand("rays", "Make a batch of rays for a store");
  verb->footer(
      "\nKinds: primary (a camera's, row by row), ao (from the primary hits, cosine-weighted, tfar the radius), "
      "bounce\n"
      "(the same without an end), shadow (from the primary hits to a light above, tfar 1), random (segments between\n"
      "two uniform points of the bounds, tfar 1). Origins of ao, bounce and shadow lie off the surface by 2^-18 of "
      "the\n"
      "largest coordinate or distance they come from. (N, 8) float32; the same seed gives the same rays.\n\n"
      "  raymill rays city.mill --kind bounce --count 10M -o bounce.npy --shuffle");
  verb->add_option("STORE", options->store, "The store")->required()->type_name("X.mill");
  add_parsed(*verb, "--kind", options->kind, parse_kind, "primary, ao, bounce, random or shadow", "KIND")->required();
  add_parsed(*verb, "--count", options->count, parse_count, "How many; k, M and G are powers of 1000", "N")->required();
  verb->add_option("-o,--output", options->output, "The rays to write")->required()->type_name("RAYS.npy");
  verb->add_option("--seed", options->seed, "Another seed, other rays")->type_name("N")->capture_default_str();
  verb->add_option("--camera", options->camera, "As for render")->type_name("CAMERA");
  verb->add_option("--radius", options->radius,
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
