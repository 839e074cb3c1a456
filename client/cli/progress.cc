#include "client/cli/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "storage/base/ledger.h"
#include "storage/base/quotes.h"

namespace raymill::client {

namespace {

constexpr auto kBarPeriod = std::chrono::milliseconds(100);
constexpr auto kJsonPeriod = std::chrono::milliseconds(500);
constexpr int kBarCells = 30;

std::string formatted(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string rate_text(double per_second) {
  if (per_second >= 1e6) {
    return formatted("%.2f M", per_second / 1e6);
  }
  return per_second >= 1e3 ? formatted("%.1f k", per_second / 1e3) : formatted("%.0f ", per_second);
}

std::string time_text(double seconds) {
  const auto whole = static_cast<long long>(std::min(seconds, 359999.0) + 0.5);
  char text[32];
  if (whole >= 3600) {
    std::snprintf(text, sizeof text, "%lld:%02lld:%02lld", whole / 3600, whole / 60 % 60, whole % 60);
  } else {
    std::snprintf(text, sizeof text, "%lld:%02lld", whole / 60, whole % 60);
  }
  return text;
}

double seconds_left(const ProgressState& state) {
  return state.fraction > 0 ? state.elapsed_seconds * (1 - state.fraction) / state.fraction : 0;
}

std::string bar(const ProgressState& state) {
  const int filled = static_cast<int>(std::lround(state.fraction * kBarCells));
  std::string text(state.phase);
  text += " [" + std::string(static_cast<std::size_t>(filled), '#') +
          std::string(static_cast<std::size_t>(kBarCells - filled), '.') + "] " +
          formatted("%3.0f%%", std::floor(state.fraction * 100));
  if (!state.unit.empty() && state.elapsed_seconds > 0) {
    text += "  " + rate_text(static_cast<double>(state.done) / state.elapsed_seconds) + std::string(state.unit) + "/s";
  }
  if (state.paged_bytes > 0) {
    text += "  " + storage::format_bytes(state.paged_bytes) + " paged";
  }
  if (state.fraction > 0 && state.fraction < 1 && state.elapsed_seconds > 1) {
    text += "  " + time_text(seconds_left(state)) + " left";
  }
  return text;
}

std::string json_line(const ProgressState& state) {
  std::string text = "{\"phase\":\"" + std::string(state.phase) +
                     "\",\"progress\":" + formatted("%.4f", state.fraction) +
                     ",\"seconds\":" + formatted("%.3f", state.elapsed_seconds);
  if (!state.unit.empty()) {
    const double rate = state.elapsed_seconds > 0 ? static_cast<double>(state.done) / state.elapsed_seconds : 0;
    text += ",\"" + std::string(state.unit) + "_done\":" + std::to_string(state.done) + ",\"" +
            std::string(state.unit) + "_per_second\":" + formatted("%.1f", rate);
  }
  if (state.paged_bytes > 0) {
    text += ",\"paged_bytes\":" + std::to_string(state.paged_bytes);
  }
  if (state.fraction > 0) {
    text += ",\"seconds_left\":" + formatted("%.1f", seconds_left(state));
  }
  return text + "}";
}

}  // namespace

Result<ProgressStyle> parse_progress_style(std::string_view name) {
  if (name.empty()) {
    return ::isatty(STDERR_FILENO) == 1 ? ProgressStyle::bar : ProgressStyle::none;
  }
  if (name == "none") return ProgressStyle::none;
  if (name == "alf") return ProgressStyle::alf;
  if (name == "openjd") return ProgressStyle::openjd;
  if (name == "json") return ProgressStyle::json;
  return Status(ErrorCode::invalid_argument,
                in_quotes(name) + " is not a progress style; alf, openjd, json and none are");
}

std::string format_progress(ProgressStyle style, const ProgressState& state) {
  switch (style) {
    case ProgressStyle::none:
      return {};
    case ProgressStyle::bar:
      return bar(state);
    case ProgressStyle::alf:
      return "ALF_PROGRESS " + formatted("%.0f%%", std::floor(state.fraction * 100));
    case ProgressStyle::openjd:
      return "openjd_progress: " + formatted("%.1f", std::floor(state.fraction * 1000) / 10);
    case ProgressStyle::json:
      return json_line(state);
  }
  return {};
}

Progress::~Progress() {
  if (style_ == ProgressStyle::bar && !last_text_.empty()) {
    std::fprintf(stderr, "\r\033[K");
    std::fflush(stderr);
  }
}

void Progress::report(std::string_view phase, double fraction, std::uint64_t done, std::string_view unit,
                      std::uint64_t paged_bytes) {
  if (style_ == ProgressStyle::none) {
    return;
  }
  const auto now = Clock::now();
  const bool is_new_phase = phase != phase_;
  const bool is_last = fraction >= 1;
  const auto period = style_ == ProgressStyle::bar    ? kBarPeriod
                      : style_ == ProgressStyle::json ? kJsonPeriod
                                                      : Clock::duration::zero();
  if (!is_new_phase && !is_last && now - last_print_ < period) {
    return;
  }
  if (is_new_phase) {
    // The first phase began when this object was made.
    begin_ = phase_.empty() ? begin_ : now;
    phase_ = phase;
  }
  const std::string text =
      format_progress(style_, {.phase = phase,
                               .fraction = std::clamp(fraction, 0.0, 1.0),
                               .done = done,
                               .unit = unit,
                               .elapsed_seconds = std::chrono::duration<double>(now - begin_).count(),
                               .paged_bytes = paged_bytes});
  if (text == last_text_) {
    return;
  }
  last_print_ = now;
  last_text_ = text;
  // A reader that went away ends the reports, not the work.
  if (style_ == ProgressStyle::bar) {
    std::fprintf(stderr, "\r%s\033[K", text.c_str());
    std::fflush(stderr);
  } else if (std::printf("%s\n", text.c_str()) < 0 || std::fflush(stdout) != 0) {
    std::clearerr(stdout);
    style_ = ProgressStyle::none;
  }
}

}  // namespace raymill::client
