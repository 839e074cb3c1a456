#include "client/cli/options.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <thread>

#include "client/cpp/raymill.h"
#include "storage/base/atomic_file.h"

namespace raymill::client {

void ServiceOptions::add_to(CLI::App& app) {
  add_tracing_to(app);
  app.add_option("--trace", timeline_path,
                 "Write a timeline of reads, decoding and workers to this file; ui.perfetto.dev opens it")
      ->type_name("FILE.json");
  app.add_option("--page-trace", page_trace_path,
                 "Write which pages rays enter and which are read and evicted to this file (traversal/page_trace.h)")
      ->type_name("FILE");
  app.add_option("--stats", stats_path, "Write figures of the run to this file as JSON")->type_name("FILE");
}

void ServiceOptions::add_tracing_to(CLI::App& app) {
  add_parsed(app, "--memory", memory, parse_bytes,
             "Limit of the whole process: bytes, or with K, M, G, T (powers of 1024). Default 2G", "SIZE");
  app.add_option("--threads", threads, "Threads that trace; 0: one for each core")
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--isa", isa, "Instruction set: scalar, avx2 or avx512; left out: the best this machine has")
      ->type_name("ISA");
  app.add_option(
         "--policy", policy,
         "Which page is read next: score (most rays for each byte), most-rays, fifo or sweep. No answer depends "
         "on it. Default score")
      ->type_name("NAME")
      ->check(CLI::IsMember({"score", "most-rays", "fifo", "sweep"}));
  app.add_option(
         "--eviction", eviction,
         "Which page goes for it: demand (the one that the fewest waiting rays will still ask for) or clock (one "
         "that was not entered lately). No answer depends on it. Default " +
             eviction)
      ->type_name("NAME")
      ->check(CLI::IsMember({"clock", "demand"}));
  app.add_option(
         "--layout", layout,
         "How the store stands in memory: compact (pages), expanded (2.5 times the bytes, faster; read whole before "
         "the "
         "first ray) or auto (expanded where memory is plenty and rays are many). No answer depends on it. Default " +
             layout)
      ->type_name("NAME")
      ->check(CLI::IsMember({"auto", "compact", "expanded"}));
  app.add_option(
         "--sort-rays", sort_rays,
         "Whether rays are traced sorted in space: auto (where they are scattered and the store in memory is larger "
         "than "
         "the caches), never or always. Hits come in the rays' own order, and no answer depends on it. Default " +
             sort_rays)
      ->type_name("WHEN")
      ->check(CLI::IsMember({"auto", "never", "always"}));
  app.add_flag("--adversarial", adversarial,
               "For tests: every ray suspends at every node, and a page is evicted when a batch has run there");
  add_io_option(app, io);
  app.add_option("--server", server, "Trace on this server instead (ipc://PATH or tcp://HOST:PORT)")->type_name("ADDR");
  app.add_option(
         "--temp", temporary_folder,
         "Folder for rays and results that do not fit in memory (up to 50 bytes for each ray in flight). Default: "
         "TMPDIR, else beside the output")
      ->type_name("DIR");
}

unsigned ServiceOptions::thread_count() const {
  return threads > 0 ? threads : std::max(1U, std::thread::hardware_concurrency());
}

// Beside the output is room for large files; /tmp is memory on many machines.
std::string folder_for_temporaries(const ServiceOptions& options, const std::string& output) {
  if (!options.temporary_folder.empty()) {
    return options.temporary_folder;
  }
  if (const char* folder = std::getenv("TMPDIR"); folder != nullptr && *folder != '\0') {
    return folder;
  }
  std::error_code error;
  const auto status = std::filesystem::status(output, error);
  if (output.empty() || (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))) {
    return "/tmp";  // a pipe, or /dev/null
  }
  const std::filesystem::path folder = std::filesystem::path(output).parent_path();
  return folder.empty() ? "." : folder.string();
}

Result<OpenStore> open_store(const ServiceOptions& options, const std::string& name, const std::string& output) {
  const auto begin = std::chrono::steady_clock::now();
  OpenStore open;
  if (options.server.empty()) {
    EngineConfig config;
    config.memory = options.memory;
    config.threads = options.threads;
    config.isa = options.isa;
    config.policy = options.policy;
    config.eviction = options.eviction;
    config.layout = options.layout;
    config.sort_rays = options.sort_rays;
    config.adversarial = options.adversarial;
    if (!options.page_trace_path.empty()) {
      RAYMILL_ASSIGN_OR_RETURN(open.page_trace, PageTrace::create(options.page_trace_path));
      config.page_trace = open.page_trace;
    }
    if (!options.timeline_path.empty()) {
      RAYMILL_ASSIGN_OR_RETURN(open.timeline, Timeline::create(options.timeline_path));
      config.timeline = open.timeline;
    }
    config.io = options.io;
    config.spill_directory = folder_for_temporaries(options, output);
    RAYMILL_ASSIGN_OR_RETURN(open.service, Engine::create(config));
  } else if (!options.timeline_path.empty() || !options.page_trace_path.empty()) {
    return {ErrorCode::invalid_argument,
            "--trace and --page-trace record this process; with --server the work is done elsewhere"};
  } else {
    RAYMILL_ASSIGN_OR_RETURN(open.service, Client::connect({.address = options.server}));
  }
  RAYMILL_ASSIGN_OR_RETURN(open.store, open.service->open(name));
  open.open_seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return open;
}

void QueryOptions::add_to(CLI::App& app) {
  add_parsed(app, "--query", config.query, parse_query,
             "closest: the nearest hit (default). any: whether there is one. count: how many crossings a ray has. all: "
             "every crossing, in order. transmittance: what the store's fog lets pass between tnear and tfar. spans: "
             "where the fog is denser than --threshold, in order",
             "QUERY");
  add_parsed(
      app, "--mode", config.mode, parse_mode,
      "watertight: no ray passes between triangles that share an edge (default). fast: float32 only. exact: the hit "
      "of exact arithmetic, t rounded once",
      "MODE");
  add_parsed(
      app, "--fields", fields_, parse_fields,
      "What a hit holds, separated by commas: t, uv, primitive_id, geometry_id, instance_id, normal, ids, all; and "
      "where the store was built with --attributes: shading_normal, uv0, uv1, color0 (NaN where there are none). "
      "Default: t,uv,primitive_id,geometry_id; for --query any: t; for --query "
      "count: count; for --query transmittance: transmittance; for --query spans: t,t_leave,geometry_id",
      "LIST");
}

void QueryOptions::add_lists_to(CLI::App& app) {
  add_parsed(app, "--first", config.first, parse_count,
             "With --query all and spans: of each ray at most so many, the nearest", "K");
}

void QueryOptions::add_tolerance_to(CLI::App& app) {
  add_parsed(app, "--tolerance", config.tolerance, parse_length,
             "How far a hit may lie from the surface, in scene units: parts of a store built with --proxies that a ray "
             "crosses on no longer a way than twice that are not read, but taken to be hit as often as they would be "
             "on the average. Such hits have u = v = -1. For --query closest and any",
             "LENGTH");
  add_parsed(
      app, "--tolerance-angle", config.tolerance_angle, parse_length,
      "The same, as a part of the way from the ray's origin: 0.001 is a millimetre at a metre. The larger of the "
      "two counts",
      "ANGLE");
}

void QueryOptions::add_volumes_to(CLI::App& app) {
  add_parsed(
      app, "--volume-method", config.volume.method,
      [this](const std::string& text) {
        method_given_ = true;
        return parse_volume_method(text);
      },
      "With --query transmittance: exact (the integral of the trilinear field; default), march (equal steps; default "
      "with "
      "--step) or ratio (a random estimate, right on the average)",
      "NAME");
  app.add_option("--step", config.volume.step, "Of march: the longest step, in scene units")->type_name("LENGTH");
  app.add_option("--density-scale", config.volume.density_scale, "Extinction in 1 / scene unit where a voxel holds 1")
      ->type_name("X")
      ->capture_default_str();
  app.add_option("--seed", config.volume.seed, "Of ratio: the answer depends on it and on the ray itself")
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--majorant", config.volume.majorant,
                 "Of ratio: how many times the least majorant of a brick; more samples, less noise")
      ->type_name("X")
      ->capture_default_str();
  app.add_option("--threshold", config.volume.threshold,
                 "With --query spans: the voxel value that spans lie above; --density-scale does not count")
      ->type_name("X")
      ->capture_default_str();
}

Status QueryOptions::resolve_volumes() {
  const VolumeConfig plain;
  VolumeConfig& volume = config.volume;
  const bool of_volumes = method_given_ || volume.step != plain.step || volume.seed != plain.seed ||
                          volume.majorant != plain.majorant || volume.density_scale != plain.density_scale;
  if (of_volumes && config.query != Query::transmittance) {
    return {ErrorCode::invalid_argument,
            "--volume-method, --step, --density-scale, --seed and --majorant are for --query transmittance"};
  }
  if (!method_given_ && volume.step != 0) {
    volume.method = VolumeMethod::march;
  }
  if ((volume.step != 0 && volume.method != VolumeMethod::march) ||
      ((volume.seed != plain.seed || volume.majorant != plain.majorant) && volume.method != VolumeMethod::ratio)) {
    return {ErrorCode::invalid_argument, "--step is for --volume-method march, --seed and --majorant for ratio"};
  }
  if (volume.threshold != plain.threshold && config.query != Query::spans) {
    return {ErrorCode::invalid_argument, "--threshold is for --query spans"};
  }
  return {};
}

Status QueryOptions::resolve() {
  RAYMILL_RETURN_IF_ERROR(resolve_volumes());
  if (config.first != 0 && !gives_lists(config.query)) {
    return {ErrorCode::invalid_argument, "--first is for --query all and spans; closest gives the first hit"};
  }
  config.fields = answered_fields(config.query, fields_ == Field::none ? kDefaultClosestFields : fields_);
  if (fields_ != Field::none && fields_ != config.fields) {
    return {ErrorCode::invalid_argument, "--query " + std::string(to_string(config.query)) + " answers only " +
                                             to_string(config.fields) + "; leave --fields out"};
  }
  if (has(config.fields, Field::transmittance) && config.query != Query::transmittance) {
    return {ErrorCode::invalid_argument,
            "the field transmittance is answered by --query transmittance; leave it out of --fields"};
  }
  if (has(config.fields, Field::t_leave) && config.query != Query::spans) {
    return {ErrorCode::invalid_argument, "the field t_leave is answered by --query spans; leave it out of --fields"};
  }
  if (has(config.fields, Field::count) && config.query != Query::count) {
    return {ErrorCode::invalid_argument, "the field count is answered by --query count; leave it out of --fields"};
  }
  return {};
}

void add_io_option(CLI::App& app, std::string& io) {
  app.add_option("--io", io, "How pages are read: uring, pread; auto: io_uring where the kernel allows it, else pread")
      ->type_name("KIND")
      ->check(CLI::IsMember({"auto", "uring", "pread"}))
      ->capture_default_str();
}

void add_json_flag(CLI::App& app, bool& json) { app.add_flag("--json", json, "Print JSON"); }

void add_progress_option(CLI::App& app, std::string& style) {
  app.add_option(
         "--progress", style,
         "Progress on stdout: alf (Tractor), openjd (Open Job Description), json (a line each), none. Left out: "
         "a bar on stderr where that is a terminal")
      ->type_name("STYLE")
      ->check(CLI::IsMember({"alf", "openjd", "json", "none"}));
}

Status print(const std::string& text) {
  if (std::fwrite(text.data(), 1, text.size(), stdout) == text.size() && std::fflush(stdout) == 0) {
    return {};
  }
  if (errno == EPIPE) {
    return {};
  }
  return {errno == ENOSPC ? ErrorCode::disk_full : ErrorCode::io,
          std::string("cannot write to standard output: ") + std::strerror(errno)};
}

namespace {

// File names need not be UTF-8.
std::string text_of(const nlohmann::json& object) {
  return object.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

}  // namespace

Status print_json(const nlohmann::json& object) { return print(text_of(object)); }

Status write_json(storage::AtomicFile& file, const nlohmann::json& object) {
  const std::string text = text_of(object);
  RAYMILL_RETURN_IF_ERROR(file.write(std::as_bytes(std::span(text))));
  return file.commit();
}

Status write_stats(const ServiceOptions& options, const OpenStore& open, const JobStats& stats, const RunTimes& times) {
  if (open.page_trace) {
    RAYMILL_RETURN_IF_ERROR(open.page_trace->finish());
  }
  if (open.timeline) {
    RAYMILL_RETURN_IF_ERROR(open.timeline->finish());
  }
  if (options.stats_path.empty()) {
    return {};
  }
  RAYMILL_ASSIGN_OR_RETURN(auto file, storage::AtomicFile::create(options.stats_path));
  return write_json(file, stats_json(stats, times, options.memory, options.thread_count()));
}

JobStats with_peak(JobStats stats, const ServiceOptions& options) {
  if (options.server.empty()) {
    stats.peak_rss_bytes = storage::peak_resident_bytes();
  }
  return stats;
}

std::size_t buffer_rays(std::uint64_t memory_bytes) {
  constexpr std::uint64_t kMost = 32 << 10, kLeast = 1 << 10;
  // At most a 256th of the budget.
  return static_cast<std::size_t>(std::clamp(memory_bytes / 256 / sizeof(Ray), kLeast, kMost));
}

}  // namespace raymill::client
