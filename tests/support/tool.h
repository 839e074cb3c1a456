// Tool: the call of a program of the tests and benches, its options and its exit code.
//
// CLI11 stands behind it, not in it: it takes longer to compile than all the rest of such a program. Thread-confined.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace raymill::tests {

class Tool {
 public:
  class Option {
   public:
    explicit Option(CLI::Option* option) : option_(option) {}
    Option& required();
    Option& between(double least, double most);
    Option& one_of(const std::vector<std::string>& words);
    /// What stands for the value in --help.
    Option& type(const std::string& name);
    Option& excludes(const Option& other);
    /// A list in one word.
    Option& separated_by(char separator);

   private:
    CLI::Option* option_;
  };

  Tool(const std::string& name, const std::string& what);
  ~Tool();

  /// T: std::string, double, std::uint32_t, std::uint64_t, or a list of the first or third. What `value` is by now is
  /// its default; the largest number is none that --help shows. A name without "--" is that of a positional argument.
  template <typename T>
  Option option(const std::string& name, T& value, const std::string& help);
  Option flag(const std::string& name, bool& value, const std::string& help);

  /// Parses the call and does work() in our float mode. The exit code: 0; 1 where it gives false; 2 where it fails or
  /// the call is none, which is told on stderr.
  int run(int argc, char** argv, const std::function<Result<bool>()>& work);

 private:
  std::unique_ptr<CLI::App> app_;
};

}  // namespace raymill::tests
