// The verbs of the command line. Each file adds its own to the parser and hands back what to run.
#pragma once

#include <functional>
#include <vector>

#include "storage/base/status.h"

namespace CLI {
class App;
}  // namespace CLI

namespace raymill::client {

/// A verb: its parser, and what it does once the words are understood.
struct Verb {
  CLI::App* parser = nullptr;
  std::function<Status()> run;
};

Verb add_build(CLI::App& app);
Verb add_info(CLI::App& app);
Verb add_verify(CLI::App& app);
Verb add_inspect(CLI::App& app);
Verb add_trace(CLI::App& app);
Verb add_render(CLI::App& app);
Verb add_rays(CLI::App& app);
Verb add_generate(CLI::App& app);
Verb add_bench(CLI::App& app);
Verb add_accuracy(CLI::App& app);
Verb add_serve(CLI::App& app);
/// submit, status, wait, fetch, cancel, jobs.
std::vector<Verb> add_job_verbs(CLI::App& app);

}  // namespace raymill::client
