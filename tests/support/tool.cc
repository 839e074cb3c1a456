#include "tests/support/tool.h"

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <limits>

#include "traversal/simd/float_mode.h"

namespace raymill::tests {

Tool::Option& Tool::Option::required() {
  option_->required();
  return *this;
}

Tool::Option& Tool::Option::between(double least, double most) {
  option_->check(CLI::Range(least, most));
  return *this;
}

Tool::Option& Tool::Option::one_of(const std::vector<std::string>& words) {
  option_->check(CLI::IsMember(words));
  return *this;
}

Tool::Option& Tool::Option::type(const std::string& name) {
  option_->type_name(name);
  return *this;
}

Tool::Option& Tool::Option::excludes(const Option& other) {
  option_->excludes(other.option_);
  return *this;
}

Tool::Option& Tool::Option::separated_by(char separator) {
  option_->delimiter(separator);
  return *this;
}

Tool::Tool(const std::string& name, const std::string& what) : app_(std::make_unique<CLI::App>(what, name)) {}
Tool::~Tool() = default;

template <typename T>
Tool::Option Tool::option(const std::string& name, T& value, const std::string& help) {
  CLI::Option* option = app_->add_option(name, value, help);
  if (value != T() && value != std::numeric_limits<T>::max()) {
    option->capture_default_str();
  }
  return Option(option);
}

template Tool::Option Tool::option(const std::string&, std::string&, const std::string&);
template Tool::Option Tool::option(const std::string&, double&, const std::string&);
template Tool::Option Tool::option(const std::string&, std::uint32_t&, const std::string&);
template Tool::Option Tool::option(const std::string&, std::uint64_t&, const std::string&);
template Tool::Option Tool::option(const std::string&, std::vector<std::string>&, const std::string&);
template Tool::Option Tool::option(const std::string&, std::vector<std::uint32_t>&, const std::string&);

Tool::Option Tool::flag(const std::string& name, bool& value, const std::string& help) {
  return Option(app_->add_flag(name, value, help));
}

int Tool::run(int argc, char** argv, const std::function<Result<bool>()>& work) {
  constexpr int kCannotRun = 2;
  try {
    app_->parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app_->exit(error) == 0 ? 0 : kCannotRun;
  }
  const traversal::IeeeScope ieee;
  const Result<bool> result = work();
  if (!result) {
    std::fprintf(stderr, "%s: %s\n", app_->get_name().c_str(), result.status().message().c_str());
    return kCannotRun;
  }
  return *result ? 0 : 1;
}

}  // namespace raymill::tests
