// Options that several verbs share, and the services they choose.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <string>

#include "client/cli/parse.h"
#include "client/cli/progress.h"
#include "client/cli/report.h"
#include "storage/base/atomic_file.h"
#include "traversal/engine.h"
#include "traversal/service.h"

namespace raymill::client {

/// Adds an option whose words `parse` turns into `value`; words that it refuses are a usage error.
template <typename T, typename Parse>
CLI::Option* add_parsed(CLI::App& app, const std::string& name, T& value, Parse parse, const std::string& help,
                        const std::string& type) {
  const auto take = [&value, parse, name](const std::string& text) {
    auto result = parse(text);
    if (!result) {
      throw CLI::ValidationError(name, result.status().message());
    }
    value = std::move(*result);
  };
  return app.add_option_function<std::string>(name, take, help)->type_name(type);
}

/// Where rays are traced: in this process, or on a server.
struct ServiceOptions {
  std::uint64_t memory = gibibytes(2);
  unsigned threads = 0;
  std::string isa;
  std::string policy = EngineConfig().policy;
  std::string eviction = EngineConfig().eviction;
  std::string layout = EngineConfig().layout;
  std::string sort_rays = EngineConfig().sort_rays;
  bool adversarial = false;
  std::string io = "auto";
  std::string server;
  std::string stats_path;
  std::string timeline_path;
  std::string page_trace_path;
  std::string temporary_folder;  ///< of what does not fit in memory; empty: TMPDIR, else beside the output

  /// Where and how rays are traced, and what is recorded of it.
  void add_to(CLI::App& app);
  /// Without what is recorded, for verbs that open stores several times.
  void add_tracing_to(CLI::App& app);
  /// `threads`, with 0 resolved to this machine's cores.
  [[nodiscard]] unsigned thread_count() const;
};

/// Where what does not fit in memory goes: --temp, TMPDIR, beside `output` (if it is or will be a plain file), else
/// /tmp.
std::string folder_for_temporaries(const ServiceOptions& options, const std::string& output);

/// An open store, the service that serves it, and how long opening took.
struct OpenStore {
  std::shared_ptr<Timeline> timeline;     ///< where one was asked for
  std::shared_ptr<PageTrace> page_trace;  ///< likewise
  std::unique_ptr<Service> service;
  std::shared_ptr<Store> store;
  double open_seconds = 0;
};
/// Opens `name` on the server if one is given, else in this process under the budget. What the process holds at this
/// moment counts as used, so buffers are allocated before.
/// `output`: what the verb will write, if anything.
Result<OpenStore> open_store(const ServiceOptions& options, const std::string& name, const std::string& output = {});

struct QueryOptions {
  TraceConfig config;

  void add_to(CLI::App& app);
  /// Of what only trace answers.
  void add_lists_to(CLI::App& app);
  /// Of how it answers transmittance and spans.
  void add_volumes_to(CLI::App& app);
  /// Fills in what was left out and refuses what does not go together.
  Status resolve();

 private:
  Status resolve_volumes();

  Field fields_ = Field::none;
  bool method_given_ = false;
};

void add_io_option(CLI::App& app, std::string& io);
void add_json_flag(CLI::App& app, bool& json);
void add_progress_option(CLI::App& app, std::string& style);

/// Prints to stdout; a reader that went away is not an error.
Status print(const std::string& text);
Status print_json(const nlohmann::json& object);
/// Writes the object and gives the file its name.
Status write_json(storage::AtomicFile& file, const nlohmann::json& object);
/// Writes the stats object and finishes the timeline, where they were asked for.
Status write_stats(const ServiceOptions& options, const OpenStore& open, const JobStats& stats, const RunTimes& times);

/// Fills peak_rss_bytes with this process's own where the rays were traced here.
JobStats with_peak(JobStats stats, const ServiceOptions& options);

/// Rays that a verb holds at once as it reads or makes them: 32 Ki (1 MiB), fewer under small budgets.
std::size_t buffer_rays(std::uint64_t memory_bytes);

}  // namespace raymill::client
