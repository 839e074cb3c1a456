// submit, status, wait, fetch, cancel, jobs: batches that live on a server.

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "client/cli/interrupt.h"
#include "client/cli/npy.h"
#include "client/cli/options.h"
#include "client/cli/ray_file.h"
#include "client/cli/verbs.h"
#include "client/cpp/raymill.h"
#include "storage/base/atomic_file.h"

namespace raymill::client {

namespace {

// A wait asks again after so long, to notice a signal.
constexpr double kWaitStepSeconds = 0.5;

struct JobsOptions {
  std::string server = ClientConfig().address;
  std::string id;
  std::string store;
  std::string rays;
  std::string output;
  QueryOptions query;
  std::string progress;
  double timeout_seconds = 0;
  bool json = false;
};

Result<std::unique_ptr<Client>> connect(const JobsOptions& options) {
  return Client::connect({.address = options.server});
}

Status show(const JobsOptions& options, const JobInfo& job) {
  return options.json ? print_json(job_json(job)) : print(job_text(job));
}

Status submit(JobsOptions& options) {
  RAYMILL_RETURN_IF_ERROR(options.query.resolve());
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  RAYMILL_ASSIGN_OR_RETURN(RayFileReader reader, RayFileReader::open(options.rays));
  RAYMILL_ASSIGN_OR_RETURN(const auto client, connect(options));
  if (reader.is_wide()) {
    RAYMILL_ASSIGN_OR_RETURN(const auto store, client->open(options.store));
    RAYMILL_ASSIGN_OR_RETURN(options.query.config.float64, store->keeps_float64());
    if (!options.query.config.float64) {
      RAYMILL_ASSIGN_OR_RETURN(const auto origin, store->origin());
      reader.set_origin(origin);
      options.query.config.relative = origin != std::array<double, 3>{};
    }
  }
  std::optional<Progress> progress(style);
  const double total = reader.count() > 0 ? static_cast<double>(reader.count()) : 1;
  std::uint64_t sent = 0;
  const auto note = [&](const Result<std::size_t>& read) -> Result<std::size_t> {
    if (interrupted()) {
      return interrupted_status();
    }
    sent += read.ok() ? *read : 0;
    progress->report("submit", static_cast<double>(sent) / total, sent, "rays");
    return read;
  };
  const auto id = options.query.config.float64
                      ? client->submit64(options.store, options.query.config,
                                         [&](std::span<Ray64> rays) { return note(reader.read64(rays)); })
                      : client->submit(options.store, options.query.config,
                                       [&](std::span<Ray> rays) { return note(reader.read(rays)); });
  progress.reset();
  if (!id) {
    return id.status();
  }
  return options.json ? print_json({{"id", *id}, {"rays", sent}}) : print(*id + "\n");
}

Status status(const JobsOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const auto client, connect(options));
  RAYMILL_ASSIGN_OR_RETURN(const JobInfo job, client->job(options.id));
  return show(options, job);
}

// How a job that has come to its end ends this process.
Status outcome(const JobInfo& job) {
  switch (job.state) {
    case JobState::failed:
      return {ErrorCode::corrupt, "job " + job.id + " failed" + (job.message.empty() ? "" : ": " + job.message)};
    case JobState::cancelled:
      return {ErrorCode::cancelled, "job " + job.id + " was cancelled"};
    case JobState::queued:
    case JobState::running:
    case JobState::done:
      break;
  }
  return {};
}

Status wait(const JobsOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  RAYMILL_ASSIGN_OR_RETURN(const auto client, connect(options));
  std::optional<Progress> progress(style);
  double waited_seconds = 0;
  while (!interrupted()) {
    double step_seconds = kWaitStepSeconds;
    if (options.timeout_seconds > 0) {
      step_seconds = std::min(step_seconds, options.timeout_seconds - waited_seconds);
    }
    const auto job = client->wait(options.id, step_seconds);
    if (job) {
      progress.reset();
      RAYMILL_RETURN_IF_ERROR(show(options, *job));
      return outcome(*job);
    }
    if (job.status().code() != ErrorCode::busy_retry) {
      return job.status();
    }
    waited_seconds += step_seconds;
    if (options.timeout_seconds > 0 && waited_seconds >= options.timeout_seconds) {
      return {ErrorCode::busy_retry, "job " + options.id + " is not done after the time given; ask again"};
    }
    if (const auto state = client->job(options.id); state && state->rays > 0) {
      progress->report("wait", static_cast<double>(state->rays_done) / static_cast<double>(state->rays),
                       state->rays_done, "rays");
    }
  }
  return interrupted_status();
}

Status fetch(const JobsOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  RAYMILL_ASSIGN_OR_RETURN(const auto client, connect(options));
  RAYMILL_ASSIGN_OR_RETURN(auto file, storage::AtomicFile::create(options.output));
  std::optional<Progress> progress(style);
  std::uint64_t total_bytes = 0, done_bytes = 0, total_rays = 0;
  RAYMILL_RETURN_IF_ERROR(client->fetch(
      options.id,
      [&](const HitLayout& layout, std::uint64_t rays) {
        total_rays = rays;
        total_bytes = rays * layout.row_bytes();
        const std::string header = npy_header(layout.numpy_descr(), rays, 0);
        return file.write(std::as_bytes(std::span(header)));
      },
      [&](std::span<const std::byte> rows) -> Status {
        if (interrupted()) {
          return interrupted_status();
        }
        done_bytes += rows.size();
        progress->report("fetch",
                         static_cast<double>(done_bytes) / static_cast<double>(std::max(total_bytes, done_bytes)));
        return file.write(rows);
      }));
  if (done_bytes != total_bytes) {
    return {ErrorCode::internal, "job " + options.id + ": " + std::to_string(done_bytes) +
                                     " bytes of hits came where " + std::to_string(total_bytes) + " were announced"};
  }
  RAYMILL_RETURN_IF_ERROR(file.commit());
  progress.reset();
  return options.json ? print_json({{"id", options.id}, {"hits", options.output}, {"rays", total_rays}})
                      : print(options.output + ": " + std::to_string(total_rays) + " rays\n");
}

Status cancel(const JobsOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const auto client, connect(options));
  RAYMILL_RETURN_IF_ERROR(client->cancel(options.id));
  return options.json ? print_json({{"id", options.id}, {"cancelled", true}}) : Status();
}

Status jobs(const JobsOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const auto client, connect(options));
  RAYMILL_ASSIGN_OR_RETURN(const std::vector<JobInfo> list, client->jobs());
  nlohmann::json array = nlohmann::json::array();
  std::string text;
  for (const JobInfo& job : list) {
    array.push_back(job_json(job));
    text += job_text(job);
  }
  return options.json ? print_json(array) : print(text);
}

struct Added {
  CLI::App* verb;
  std::shared_ptr<JobsOptions> options;
};

Added add(CLI::App& app, const char* name, const char* what, bool takes_id) {
  const auto options = std::make_shared<JobsOptions>();
  CLI::App* verb = app.add_subcommand(name, what);
  if (takes_id) {
    verb->add_option("ID", options->id, "The job, as submit printed it")->required()->type_name("");
  }
  verb->add_option("--server", options->server, "The server (ipc://PATH or tcp://HOST:PORT)")
      ->type_name("ADDR")
      ->capture_default_str();
  add_json_flag(*verb, options->json);
  return {verb, options};
}

}  // namespace

std::vector<Verb> add_job_verbs(CLI::App& app) {
  std::vector<Verb> verbs;
  {
    const auto [verb, options] = add(app, "submit", "Hand a file of rays to a server and leave", false);
    verb->footer("\nPrints the job's id. The server keeps the hits until they are fetched and the job is cancelled.");
    verb->add_option("STORE", options->store, "The store's name on the server")->required()->type_name("X.mill");
    verb->add_option("RAYS", options->rays, "The rays, as for trace")->required()->type_name("RAYS.npy");
    options->query.add_to(*verb);
    add_progress_option(*verb, options->progress);
    verbs.push_back({verb, [options = options] { return submit(*options); }});
  }
  {
    const auto [verb, options] = add(app, "status", "Say how a job stands", true);
    verbs.push_back({verb, [options = options] { return status(*options); }});
  }
  {
    const auto [verb, options] = add(app, "wait", "Wait until a job is done", true);
    verb->footer("\nExit codes: 0 done, 42 failed, 75 not done in time, 130 cancelled.");
    verb->add_option("--timeout", options->timeout_seconds, "Seconds to wait at most; 0: without end")
        ->type_name("SECONDS")
        ->check(CLI::NonNegativeNumber);
    add_progress_option(*verb, options->progress);
    verbs.push_back({verb, [options = options] { return wait(*options); }});
  }
  {
    const auto [verb, options] = add(app, "fetch", "Write a finished job's hits to a file", true);
    verb->add_option("-o,--output", options->output, "The hits to write")->required()->type_name("HITS.npy");
    add_progress_option(*verb, options->progress);
    verbs.push_back({verb, [options = options] { return fetch(*options); }});
  }
  {
    const auto [verb, options] = add(app, "cancel", "Stop a job, or drop the hits of a finished one", true);
    verbs.push_back({verb, [options = options] { return cancel(*options); }});
  }
  {
    const auto [verb, options] = add(app, "jobs", "List a server's jobs", false);
    verbs.push_back({verb, [options = options] { return jobs(*options); }});
  }
  return verbs;
}

}  // namespace raymill::client
