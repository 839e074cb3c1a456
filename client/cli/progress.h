// Progress of a verb: a bar on a terminal's stderr, or lines for a render farm on stdout.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::client {

/// bar: on a terminal. alf: "ALF_PROGRESS 42%" (Pixar Tractor). openjd: "openjd_progress: 42.0" (Open Job
/// Description). json: one object a line.
enum class ProgressStyle : std::uint8_t { none, bar, alf, openjd, json };

/// The style that `name` asks for; for the empty name a bar where stderr is a terminal, else nothing.
Result<ProgressStyle> parse_progress_style(std::string_view name);

struct ProgressState {
  std::string_view phase = {};  ///< "trace", "build", ...
  double fraction = 0;          ///< in [0, 1]
  std::uint64_t done = 0;       ///< of `unit`; 0 where nothing is counted
  std::string_view unit = {};   ///< "rays"; empty where nothing is counted
  double elapsed_seconds = 0;
  std::uint64_t paged_bytes = 0;  ///< read from the store; 0 where nothing is
};

/// One report in `style`, without the line's end.
std::string format_progress(ProgressStyle style, const ProgressState& state);

/// Prints reports when there is something new to say. Thread-confined.
class Progress {
 public:
  explicit Progress(ProgressStyle style) : style_(style) {}
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress();  ///< clears the bar

  void report(std::string_view phase, double fraction, std::uint64_t done = 0, std::string_view unit = {},
              std::uint64_t paged_bytes = 0);

 private:
  using Clock = std::chrono::steady_clock;

  ProgressStyle style_;
  Clock::time_point begin_ = Clock::now();
  Clock::time_point last_print_{};
  std::string last_text_;
  std::string phase_;
};

}  // namespace raymill::client
