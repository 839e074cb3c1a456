#include <CLI/CLI.hpp>
#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "client/cli/interrupt.h"
#include "client/cli/options.h"
#include "client/cli/verbs.h"
#include "server/server.h"

namespace raymill::client {

namespace {

struct ServeOptions {
  server::ServeConfig config;
};

Status run(const ServeOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const auto server, server::Server::start(options.config));
  RAYMILL_RETURN_IF_ERROR(
      print("raymill serves " + options.config.stores_directory + " at " + server->endpoint() + "\n"));
  // The signal's handler sets a flag; this thread turns it into a stop.
  constexpr auto kPeriod = std::chrono::milliseconds(50);
  std::atomic<bool> ended = false;
  std::thread watcher([&] {
    while (!ended && !interrupted()) {
      std::this_thread::sleep_for(kPeriod);
    }
    server->stop();
  });
  const Status status = server->run();
  ended = true;
  watcher.join();
  return status;
}

}  // namespace

Verb add_serve(CLI::App& app) {
  const auto options = std::make_shared<ServeOptions>();
  server::ServeConfig& config = options->config;
  CLI::App* verb = app.add_subcommand("serve", "Answer rays for other processes and machines");
  verb->footer(
      "\nServes the stores below one folder, under one memory budget, until SIGINT or SIGTERM; running jobs are "
      "cancelled\n"
      "then, and the exit code is 0. Prints one line with the address once clients can connect.\n\n"
      "  raymill serve --stores /srv/scenes --bind ipc:///run/raymill.sock --memory 16G");
  verb->add_option("--stores", config.stores_directory, "Folder with the stores; clients name them relative to it")
      ->required()
      ->type_name("DIR");
  verb->add_option("--bind", config.bind, "Address: ipc://PATH, or tcp://127.0.0.1:PORT (0: any free port)")
      ->type_name("ADDR")
      ->capture_default_str();
  add_parsed(*verb, "--memory", config.memory, parse_bytes,
             "Limit of the whole process: bytes, or with K, M, G, T. Default 2G", "SIZE");
  verb->add_option("--threads", config.threads, "Threads that trace; 0: one for each core")
      ->type_name("N")
      ->capture_default_str();
  verb->add_option("--isa", config.isa, "Instruction set: scalar, avx2 or avx512; left out: the best")
      ->type_name("ISA");
  add_io_option(*verb, config.io);
  verb->add_option("--max-jobs", config.max_jobs, "Jobs that run at once; others wait")
      ->type_name("N")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  verb->add_option("--max-stores", config.max_stores, "Stores open at once; each gets its share of the memory")
      ->type_name("N")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  verb->add_option("--idle-seconds", config.idle_seconds, "A store without jobs is closed after so long")
      ->type_name("SECONDS")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  verb->add_option("--spool", config.spool_directory, "Folder for hits of submitted jobs. Default TMPDIR, else /tmp")
      ->type_name("DIR");
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
