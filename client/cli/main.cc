// raymill: the command line. Written on the public calls and nothing else.

#include <malloc.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "client/cli/interrupt.h"
#include "client/cli/verbs.h"

namespace {

using raymill::ErrorCode;
using raymill::Status;
using raymill::client::Verb;

constexpr int kUsageError = 2;
constexpr int kSignalBase = 128;

constexpr const char* kFooter = R"(
Sizes are bytes, or take K, M, G, T (powers of 1024). Lengths are in scene units.
Exit codes: 0 done, 2 usage, 33 the memory budget cannot be met, 42 bad input or a
damaged store, 75 temporary (try again), 130 and 143 stopped by SIGINT and SIGTERM.
'raymill VERB --help' explains a verb.)";

// The process must stay inside --memory: freed memory goes back to the system, and threads share one heap.
void keep_heap_small() {
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, 256 << 10);
  mallopt(M_TRIM_THRESHOLD, 256 << 10);
}

int report(const Status& status) {
  if (status.ok()) {
    return 0;
  }
  std::fprintf(stderr, "raymill: %s\n", status.message().c_str());
  if (status.code() == ErrorCode::interrupted && raymill::client::interrupted()) {
    return kSignalBase + raymill::client::interrupt_signal();
  }
  return raymill::exit_code(status.code());
}

int run(int argc, char** argv) {
  CLI::App app("Out-of-core batch ray tracing: build a scene store once, then ask it millions of rays.", "raymill");
  app.footer(kFooter);
  app.require_subcommand(1);
  app.set_version_flag("--version", "raymill " RAYMILL_VERSION);
  std::vector<Verb> verbs = {
      raymill::client::add_build(app),   raymill::client::add_info(app),     raymill::client::add_verify(app),
      raymill::client::add_inspect(app), raymill::client::add_trace(app),    raymill::client::add_render(app),
      raymill::client::add_serve(app),   raymill::client::add_generate(app), raymill::client::add_rays(app)};
  for (Verb& verb : raymill::client::add_job_verbs(app)) {
    verbs.push_back(std::move(verb));
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) {
      return app.exit(error);
    }
    std::string message = error.what();
    while (!message.empty() && (message.back() == '\n' || message.back() == ' ')) {
      message.pop_back();
    }
    std::fprintf(stderr, "raymill: %s; see 'raymill --help'\n", message.c_str());
    return kUsageError;
  }
  for (const Verb& verb : verbs) {
    if (verb.parser->parsed()) {
      return report(verb.run());
    }
  }
  return kUsageError;
}

}  // namespace

int main(int argc, char** argv) {
  keep_heap_small();
  raymill::client::install_signal_handlers();
  try {
    return run(argc, argv);
  } catch (const std::bad_alloc&) {
    return report({ErrorCode::budget_exceeded, "the system gave no more memory"});
  } catch (const std::exception& error) {
    return report({ErrorCode::internal, std::string("a bug of Raymill: ") + error.what()});
  }
}
