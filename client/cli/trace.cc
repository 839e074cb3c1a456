#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/batch.h"
#include "client/cli/hit_file.h"
#include "client/cli/list_files.h"
#include "client/cli/npy.h"
#include "client/cli/options.h"
#include "client/cli/ray_columns.h"
#include "client/cli/ray_file.h"
#include "client/cli/verbs.h"
#include "storage/base/checksum.h"

namespace raymill::client {

namespace {

struct TraceOptions {
  std::string store;
  std::string rays;
  std::string output;
  QueryOptions query;
  ServiceOptions service;
  RayColumns::Paths columns;
  std::string geometry_masks;
  std::string progress;
  bool json = false;
  bool resume = false;
};

// What the rows depend on: a part of the hits goes on only where all of it is the same.
nlohmann::json run_of(const TraceOptions& options, const RayFileReader& reader, const RayColumns& columns,
                      const StoreInfo& store) {
  const auto& masks = options.query.config.geometry_masks;
  const VolumeConfig& volume = options.query.config.volume;
  nlohmann::json run = {{"rays", options.rays},
                        {"rays_file", reader.identity()},
                        {"ray_count", reader.count()},
                        {"columns", columns.identity()},
                        {"mask", options.query.config.mask},
                        {"geometry_masks", masks ? storage::checksum(std::as_bytes(std::span(*masks))) : 0},
                        {"store", {store.name, store.triangles, store.nodes, store.store_bytes, store.decoded_bytes}},
                        {"query", to_string(options.query.config.query)},
                        {"mode", to_string(options.query.config.mode)},
                        {"fields", static_cast<unsigned>(options.query.config.fields)}};
  if (options.query.config.query == Query::transmittance) {
    run["volume"] = {to_string(volume.method), volume.step, volume.density_scale, volume.seed, volume.majorant};
  }
  if (const TraceConfig& config = options.query.config; config.tolerance != 0 || config.tolerance_angle != 0) {
    run["tolerance"] = {config.tolerance, config.tolerance_angle};
  }
  return run;
}

// Where the answers go: a file of rows, a row a ray, or files of lists.
class Answers {
 public:
  // What is made before the engine.
  Status create(const TraceOptions& options, std::uint64_t ray_count) {
    const HitLayout layout(options.query.config.fields);
    if (gives_lists(options.query.config.query)) {
      if (options.resume) {
        return {ErrorCode::invalid_argument, "--resume goes on with queries that have a row a ray; leave it out"};
      }
      RAYMILL_ASSIGN_OR_RETURN(ListFiles whole, ListFiles::create(options.output, layout, ray_count));
      lists_.emplace(std::move(whole));
    } else if (!options.resume) {
      RAYMILL_ASSIGN_OR_RETURN(HitFile whole, HitFile::create(options.output, header_of(layout, ray_count)));
      rows_.emplace(std::move(whole));
    }
    return {};
  }
  Status resume(const TraceOptions& options, std::uint64_t ray_count, const nlohmann::json& run) {
    const HitLayout layout(options.query.config.fields);
    RAYMILL_ASSIGN_OR_RETURN(HitFile part,
                             HitFile::resume(options.output, header_of(layout, ray_count), layout.row_bytes(), run));
    rays_done_ = part.rows_done();
    rows_.emplace(std::move(part));
    return {};
  }

  // Rays that are answered.
  [[nodiscard]] std::uint64_t rays_done() const { return lists_ ? lists_->rays_done() : rays_done_; }
  Status write(const HitChunk& chunk) {
    if (lists_) {
      return lists_->write(chunk);
    }
    rays_done_ += chunk.size();
    return rows_->write(chunk.rows());
  }
  Status commit() { return lists_ ? lists_->commit() : rows_->commit(); }

 private:
  static std::string header_of(const HitLayout& layout, std::uint64_t ray_count) {
    return npy_header(layout.numpy_descr(), ray_count, 0);
  }
  std::optional<HitFile> rows_;
  std::optional<ListFiles> lists_;
  std::uint64_t rays_done_ = 0;
};

// What the job is to be asked for besides.
Status read_masks(TraceOptions& options) {
  TraceConfig& config = options.query.config;
  config.skips = !options.columns.skip.empty();
  config.masks = !options.columns.masks.empty();
  if (!options.geometry_masks.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(std::vector<std::uint32_t> masks, read_geometry_masks(options.geometry_masks));
    config.geometry_masks = std::make_shared<const std::vector<std::uint32_t>>(std::move(masks));
  }
  return {};
}

// Rays of float64 go as they are where the store keeps more of them than float32; else they are rounded here, relative
// to the store's origin.
Status prepare_wide_rays(TraceOptions& options, const Store& store, RayFileReader& reader) {
  if (!reader.is_wide()) {
    return {};
  }
  RAYMILL_ASSIGN_OR_RETURN(options.query.config.float64, store.keeps_float64());
  if (!options.query.config.float64) {
    RAYMILL_ASSIGN_OR_RETURN(const auto origin, store.origin());
    reader.set_origin(origin);
    options.query.config.relative = origin != std::array<double, 3>{};
  }
  return {};
}

Status run(TraceOptions& options) {
  RAYMILL_RETURN_IF_ERROR(options.query.resolve());
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  // Everything that needs memory comes before the engine, which counts what the process holds.
  RAYMILL_ASSIGN_OR_RETURN(RayFileReader reader, RayFileReader::open(options.rays));
  std::vector<Ray> buffer(buffer_rays(options.service.memory));
  std::vector<Ray64> wide_buffer(reader.is_wide() ? buffer.size() : 0);
  RAYMILL_ASSIGN_OR_RETURN(RayColumns columns, RayColumns::open(options.columns, reader.count(), buffer.size()));
  RAYMILL_RETURN_IF_ERROR(read_masks(options));
  Answers answers;
  RAYMILL_RETURN_IF_ERROR(answers.create(options, reader.count()));
  RAYMILL_ASSIGN_OR_RETURN(const OpenStore open, open_store(options.service, options.store, options.output));
  RAYMILL_RETURN_IF_ERROR(prepare_wide_rays(options, *open.store, reader));
  if (options.resume) {
    RAYMILL_ASSIGN_OR_RETURN(const StoreInfo info, open.store->info());
    RAYMILL_RETURN_IF_ERROR(answers.resume(options, reader.count(), run_of(options, reader, columns, info)));
    reader.skip(answers.rays_done());
    columns.skip(answers.rays_done());
  }
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, open.store->trace(options.query.config));
  std::optional<Progress> progress(style);
  const double total = reader.count() > 0 ? static_cast<double>(reader.count()) : 1;
  const std::uint64_t rays_before = answers.rays_done();
  BatchTimes times;
  const bool brings = options.query.config.skips || options.query.config.masks;
  const HitSink sink = [&](const HitChunk& chunk) { return answers.write(chunk); };
  const BatchObserver observer = [&](const JobProgress& state) {
    progress->report("trace", static_cast<double>(rays_before + state.rays_done) / total, state.rays_done, "rays",
                     state.bytes_read);
  };
  const ExtrasSource extras = brings ? [&columns](std::size_t rays) { return columns.read(rays); } : ExtrasSource();
  const RaySource rays = [&]() -> Result<std::span<const Ray>> {
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read(buffer));
    return std::span<const Ray>(buffer).first(count);
  };
  const WideRaySource wide_rays = [&]() -> Result<std::span<const Ray64>> {
    RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read64(wide_buffer));
    return std::span<const Ray64>(wide_buffer).first(count);
  };
  const Status status = options.query.config.float64 ? run_batch(*job, wide_rays, sink, observer, times, extras)
                                                     : run_batch(*job, rays, sink, observer, times, extras);
  if (status.code() == ErrorCode::interrupted && options.resume) {
    return {status.code(),
            status.message() + "; " + options.output + ".part holds what is finished, repeat the command to go on"};
  }
  RAYMILL_RETURN_IF_ERROR(status);
  if (answers.rays_done() != reader.count()) {
    return {ErrorCode::internal, "a bug of Raymill: " + std::to_string(answers.rays_done()) + " answers for " +
                                     std::to_string(reader.count()) + " rays"};
  }
  RAYMILL_RETURN_IF_ERROR(answers.commit());
  progress.reset();
  const JobStats stats = with_peak(job->stats(), options.service);
  const RunTimes run_times{open.open_seconds, times.input_seconds, times.output_seconds};
  RAYMILL_RETURN_IF_ERROR(write_stats(options.service, open, stats, run_times));
  return options.json ? print_json(stats_json(stats, run_times, options.service.memory, options.service.thread_count()))
                      : print(stats_text(stats));
}

// Options of what rays bring, and of what it is held against.
void add_columns(CLI::App& verb, TraceOptions& options) {
  verb.add_option("--skip", options.columns.skip,
                  "A primitive for each ray that it passes through, as the surface that it leaves: .npy of uint32, "
                  "shape (N, 2), geometry_id and primitive_id; 4294967295 for none")
      ->type_name("IDS.npy");
  verb.add_option("--geometry-masks", options.geometry_masks,
                  "Masks of geometries: .npy of uint32, shape (G,). A triangle is a hit where a bit is set in its "
                  "geometry's mask and in the ray's; geometries beyond G have all bits")
      ->type_name("MASKS.npy");
  verb.add_option("--mask", options.query.config.mask, "The mask of every ray. Default: all bits")->type_name("BITS");
  verb.add_option("--ray-masks", options.columns.masks, "A mask for each ray, besides: .npy of uint32, shape (N,)")
      ->type_name("MASKS.npy");
}

}  // namespace

Verb add_trace(CLI::App& app) {
  const auto options = std::make_shared<TraceOptions>();
  CLI::App* verb = app.add_subcommand("trace", "Answer a file of rays");
  verb->footer(
      "\nRays: .npy, little-endian float32 or float64, C order, shape (N, 6): org, dir, with tnear 0 and tfar inf; or\n"
      "(N, 8): org, tnear, dir, tfar. t counts in lengths of dir; a hit has tnear <= t <= tfar. Of float64, org and "
      "dir\n"
      "are rounded to the nearest float32, tnear up and tfar down, so that a hit lies in the interval of the file.\n"
      "Rays are in world space. Where the store has an origin (raymill info), org is taken relative to it in float64\n"
      "before it is rounded, so write rays of float64 where the scene lies far out; where parts have origins of their\n"
      "own (feature origins), org keeps all its digits on the way to them.\n"
      "Hits: one structured .npy of N rows in the rays' order. A miss has t = inf and ids 4294967295; an invalid ray\n"
      "(NaN, infinite, zero dir, crossed interval) has t = NaN. Both files are streamed, so they may be of any size.\n"
      "--query count: a plain .npy of N uint32; 4294967295 for an invalid ray. --query transmittance: one of N "
      "float32; NaN\n"
      "for an invalid ray. --query all: HITS.npy holds the hits "
      "of\n"
      "all rays, by t within a ray, and HITS.offsets.npy (N + 1 uint64) says where those of each begin and end. "
      "--query\n"
      "spans: the same of spans, with t, t_leave and geometry_id.\n\n"
      "  raymill trace city.mill rays.npy -o hits.npy --memory 512M --stats run.json");
  verb->add_option("STORE", options->store, "The store; with --server its name there")->required()->type_name("X.mill");
  verb->add_option("RAYS", options->rays, "The rays")->required()->type_name("RAYS.npy");
  verb->add_option("-o,--output", options->output, "The hits to write")->required()->type_name("HITS.npy");
  verb->add_flag("--resume", options->resume,
                 "Keep what is finished in HITS.npy.part when the run is stopped, and go on from there when it is "
                 "repeated");
  add_columns(*verb, *options);
  options->query.add_to(*verb);
  options->query.add_lists_to(*verb);
  options->query.add_tolerance_to(*verb);
  options->query.add_volumes_to(*verb);
  options->service.add_to(*verb);
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
