// raymill: the command line. Written on the public calls and nothing else.

#include <malloc.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/interrupt.h"
#include "client/cli/options.h"
#include "client/cli/verbs.h"
#include "storage/base/quotes.h"

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

// CLI11's help with descriptions broken into lines.
class HelpFormatter final : public CLI::Formatter {
 public:
  HelpFormatter() { column_width(kNameColumns); }
  std::string make_option_desc(const CLI::Option* option) const override {
    std::string text;
    std::size_t line_begin = 0;
    std::istringstream words(CLI::Formatter::make_option_desc(option));
    for (std::string word; words >> word;) {
      if (text.size() + 1 + word.size() - line_begin > kTextColumns) {
        text += '\n';
        line_begin = text.size();
      } else if (!text.empty()) {
        text += ' ';
      }
      text += word;
    }
    return text;
  }

 private:
  static constexpr std::size_t kNameColumns = 30;
  static constexpr std::size_t kTextColumns = 80;
};

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

// Help and version go to stdout; everything else is a mistake in the words.
int answer(const CLI::App& app, const CLI::ParseError& error, int argc, char** argv) {
  if (error.get_exit_code() == static_cast<int>(CLI::ExitCodes::Success)) {
    std::ostringstream text;
    app.exit(error, text, text);
    return report(raymill::client::print(text.str()));
  }
  const std::string first = argc > 1 ? argv[1] : "";
  const auto verbs = app.get_subcommands([&](const CLI::App* candidate) { return candidate->get_name() == first; });
  const bool is_verb = !verbs.empty();
  std::string message = error.what();
  if (!is_verb && !first.empty() && first[0] != '-') {
    message = raymill::in_quotes(first) + " is not a verb";
  } else if (first.empty()) {
    message = "say what to do";
  }
  while (!message.empty() && (message.back() == '\n' || message.back() == ' ')) {
    message.pop_back();
  }
  std::fprintf(stderr, "raymill: %s; see 'raymill %s--help'\n", message.c_str(), is_verb ? (first + " ").c_str() : "");
  return kUsageError;
}

int run(int argc, char** argv) {
  CLI::App app("Out-of-core batch ray tracing: build a scene store once, then ask it millions of rays.", "raymill");
  app.formatter(std::make_shared<HelpFormatter>());
  app.footer(kFooter);
  app.require_subcommand(1);
  app.set_version_flag("--version", "raymill " RAYMILL_VERSION);
  std::vector<Verb> verbs = {
      raymill::client::add_build(app),   raymill::client::add_info(app),     raymill::client::add_verify(app),
      raymill::client::add_inspect(app), raymill::client::add_trace(app),    raymill::client::add_render(app),
      raymill::client::add_serve(app),   raymill::client::add_generate(app), raymill::client::add_rays(app),
      raymill::client::add_bench(app),   raymill::client::add_accuracy(app)};
  for (Verb& verb : raymill::client::add_job_verbs(app)) {
    verbs.push_back(std::move(verb));
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return answer(app, error, argc, argv);
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
