#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/cli/batch.h"
#include "client/cli/hit_file.h"
#include "client/cli/list_files.h"
#include "client/cli/npy.h"
#include "client/cli/options.h"
#include "client/cli/ray_file.h"
#include "client/cli/verbs.h"

namespace raymill::client {

namespace {

struct TraceOptions {
  std::string store;
  std::string rays;
  std::string output;
  QueryOptions query;
  ServiceOptions service;
  std::string progress;
  bool json = false;
  bool resume = false;
};

// What the rows depend on: a part of the hits goes on only where all of it is the same.
nlohmann::json run_of(const TraceOptions& options, const RayFileReader& reader, const StoreInfo& store) {
  return {{"rays", options.rays},
          {"rays_file", reader.identity()},
          {"ray_count", reader.count()},
          {"store", {store.name, store.triangles, store.nodes, store.store_bytes, store.decoded_bytes}},
          {"query", to_string(options.query.config.query)},
          {"mode", to_string(options.query.config.mode)},
          {"fields", static_cast<unsigned>(options.query.config.fields)}};
}

Status run(TraceOptions& options) {
  RAYMILL_RETURN_IF_ERROR(options.query.resolve());
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  // Everything that needs memory comes before the engine, which counts what the process holds.
  RAYMILL_ASSIGN_OR_RETURN(RayFileReader reader, RayFileReader::open(options.rays));
  std::vector<Ray> buffer(buffer_rays(options.service.memory));
  const HitLayout layout(options.query.config.fields);
  const std::string header = npy_header(layout.numpy_descr(), reader.count(), 0);
  std::optional<HitFile> file;
  std::optional<ListFiles> lists;  // in its place
  if (options.query.config.query == Query::all) {
    if (options.resume) {
      return {ErrorCode::invalid_argument, "--resume goes on with queries that have a row a ray; leave it out"};
    }
    RAYMILL_ASSIGN_OR_RETURN(ListFiles whole, ListFiles::create(options.output, layout, reader.count()));
    lists.emplace(std::move(whole));
  } else if (!options.resume) {
    RAYMILL_ASSIGN_OR_RETURN(HitFile whole, HitFile::create(options.output, header));
    file.emplace(std::move(whole));
  }
  RAYMILL_ASSIGN_OR_RETURN(const OpenStore open, open_store(options.service, options.store, options.output));
  if (options.resume) {
    RAYMILL_ASSIGN_OR_RETURN(const StoreInfo info, open.store->info());
    RAYMILL_ASSIGN_OR_RETURN(
        HitFile part, HitFile::resume(options.output, header, layout.row_bytes(), run_of(options, reader, info)));
    file.emplace(std::move(part));
    reader.skip(file->rows_done());
  }
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, open.store->trace(options.query.config));
  std::optional<Progress> progress(style);
  const double total = reader.count() > 0 ? static_cast<double>(reader.count()) : 1;
  std::uint64_t rows = file ? file->rows_done() : 0;
  const std::uint64_t rows_before = rows;
  BatchTimes times;
  const Status status = run_batch(
      *job,
      [&]() -> Result<std::span<const Ray>> {
        RAYMILL_ASSIGN_OR_RETURN(const std::size_t count, reader.read(buffer));
        return std::span<const Ray>(buffer).first(count);
      },
      [&](const HitChunk& chunk) {
        if (lists) {
          return lists->write(chunk);
        }
        rows += chunk.size();
        return file->write(chunk.rows());
      },
      [&](const JobProgress& state) {
        progress->report("trace", static_cast<double>(rows_before + state.rays_done) / total, state.rays_done, "rays",
                         state.bytes_read);
      },
      times);
  if (status.code() == ErrorCode::interrupted && options.resume) {
    return {status.code(),
            status.message() + "; " + options.output + ".part holds what is finished, repeat the command to go on"};
  }
  RAYMILL_RETURN_IF_ERROR(status);
  rows = lists ? lists->rays_done() : rows;
  if (rows != reader.count()) {
    return {ErrorCode::internal,
            "a bug of Raymill: " + std::to_string(rows) + " answers for " + std::to_string(reader.count()) + " rays"};
  }
  RAYMILL_RETURN_IF_ERROR(lists ? lists->commit() : file->commit());
  progress.reset();
  const JobStats stats = with_peak(job->stats(), options.service);
  const RunTimes run_times{open.open_seconds, times.input_seconds, times.output_seconds};
  RAYMILL_RETURN_IF_ERROR(write_stats(options.service, open, stats, run_times));
  return options.json ? print_json(stats_json(stats, run_times, options.service.memory, options.service.thread_count()))
                      : print(stats_text(stats));
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
      "Hits: one structured .npy of N rows in the rays' order. A miss has t = inf and ids 4294967295; an invalid ray\n"
      "(NaN, infinite, zero dir, crossed interval) has t = NaN. Both files are streamed, so they may be of any size.\n"
      "--query count: a plain .npy of N uint32; 4294967295 for an invalid ray. --query all: HITS.npy holds the hits "
      "of\n"
      "all rays, by t within a ray, and HITS.offsets.npy (N + 1 uint64) says where those of each begin and end.\n\n"
      "  raymill trace city.mill rays.npy -o hits.npy --memory 512M --stats run.json");
  verb->add_option("STORE", options->store, "The store; with --server its name there")->required()->type_name("X.mill");
  verb->add_option("RAYS", options->rays, "The rays")->required()->type_name("RAYS.npy");
  verb->add_option("-o,--output", options->output, "The hits to write")->required()->type_name("HITS.npy");
  verb->add_flag("--resume", options->resume,
                 "Keep what is finished in HITS.npy.part when the run is stopped, and go on from there when it is "
                 "repeated");
  options->query.add_to(*verb);
  options->query.add_lists_to(*verb);
  options->service.add_to(*verb);
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
