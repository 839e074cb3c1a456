// info, verify, inspect: looking into stores. Nothing here writes.

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/options.h"
#include "client/cli/verbs.h"
#include "client/cpp/raymill.h"

namespace raymill::client {

namespace {

// What trace, rays and render hold of their own beyond what this verb holds: buffers, threads, the least wave of a
// picture. With a store of 14 MiB as measured by this verb, trace and rays were refused below 15 MiB, render below 16.
constexpr std::uint64_t kVerbBytes = mebibytes(2);

struct LookOptions {
  std::string store;
  std::uint32_t page = 0;
  bool json = false;
  ServiceOptions service;
};

std::shared_ptr<LookOptions> add_common(CLI::App& verb) {
  auto options = std::make_shared<LookOptions>();
  verb.add_option("STORE", options->store, "The store")->required()->type_name("X.mill");
  return options;
}

// A job without rays says which kernel a query gets.
Result<std::string> kernel_of(Store& store, Query query) {
  RAYMILL_ASSIGN_OR_RETURN(const std::unique_ptr<Job> job, store.trace({.query = query}));
  RAYMILL_RETURN_IF_ERROR(job->finish());
  while (job->next()) {
  }
  RAYMILL_RETURN_IF_ERROR(job->status());
  return job->stats().kernel;
}

Result<std::vector<std::string>> kernels_of(Store& store) {
  std::vector<std::string> kernels;
  for (const Query query : {Query::closest, Query::any, Query::count, Query::all, Query::transmittance, Query::spans}) {
    Result<std::string> kernel = kernel_of(store, query);
    if (kernel) {
      kernels.push_back(std::move(*kernel));
    } else if (!is_of_fog(query) || kernel.status().code() != ErrorCode::invalid_argument) {
      return kernel.status();  // else there is no fog
    }
  }
  return kernels;
}

Status info(const LookOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const OpenStore open, open_store(options.service, options.store));
  RAYMILL_ASSIGN_OR_RETURN(StoreInfo store, open.store->info());
  InfoExtras extras;
  // On a server jobs wait for their turn, and its own machine's kernels run.
  if (options.service.server.empty()) {
    store.least_memory_bytes += kVerbBytes;
    RAYMILL_ASSIGN_OR_RETURN(extras.kernels, kernels_of(*open.store));
    RAYMILL_ASSIGN_OR_RETURN(extras.costs, store_costs(options.store));
  }
  return options.json ? print_json(info_json(store, extras)) : print(info_text(store, extras));
}

Status verify_store(const LookOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const VerifyReport report, verify(options.store));
  if (options.json) {
    return print_json({{"store", options.store},
                       {"ok", true},
                       {"pages", report.pages},
                       {"bytes", report.bytes},
                       {"triangles", report.triangles},
                       {"volumes", report.volumes},
                       {"bricks", report.bricks}});
  }
  return print(options.store + ": whole, " + std::to_string(report.pages) + " pages, " +
               std::to_string(report.triangles) + " triangles, " +
               (report.volumes > 0
                    ? std::to_string(report.volumes) + " volumes of " + std::to_string(report.bricks) + " bricks, "
                    : "") +
               storage::format_bytes(report.bytes) + "\n");
}

Status inspect(const LookOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const std::string text, inspect_page(options.store, options.page));
  return print(text + "\n");
}

}  // namespace

Verb add_info(CLI::App& app) {
  CLI::App* verb = app.add_subcommand("info", "Say what a store holds");
  verb->footer(
      "\nShows bounds, triangles, pages, sizes in bytes, the least --memory it can be traced under, what each feature "
      "of\n"
      "the store costs in the file and in memory, the layouts it can have there, the kernel that answers each query "
      "on\n"
      "this machine (query/width/bitstack/mode/instruction set), and cameras; with --json also the import report and\n"
      "each geometry's node, mesh and primitive. Costs and kernels are not shown of a store on a server.");
  const auto options = add_common(*verb);
  verb->add_option("--server", options->service.server, "Ask this server (ipc://PATH or tcp://HOST:PORT)")
      ->type_name("ADDR");
  verb->add_option("--threads", options->service.threads, "Threads that least_memory_bytes is said for; 0: all cores")
      ->type_name("N");
  add_json_flag(*verb, options->json);
  return {verb, [options] { return info(*options); }};
}

Verb add_verify(CLI::App& app) {
  CLI::App* verb = app.add_subcommand("verify", "Check every byte of a store");
  verb->footer(
      "\nReads the whole store and checks every checksum, every rule of its structure, and that every box holds\n"
      "its triangles. Exit code 42 and one sentence where something is wrong.");
  const auto options = add_common(*verb);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return verify_store(*options); }};
}

Verb add_inspect(CLI::App& app) {
  CLI::App* verb = app.add_subcommand("inspect", "Show a page of a store as JSON");
  verb->footer("\nDecodes as far as the bytes allow, also in a damaged store.");
  const auto options = add_common(*verb);
  verb->add_option("--page", options->page, "Index of the page")->required()->type_name("N");
  verb->add_flag("--json", options->json, "Print JSON (always so)");
  return {verb, [options] { return inspect(*options); }};
}

}  // namespace raymill::client
