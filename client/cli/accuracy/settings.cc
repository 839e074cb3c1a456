#include "client/cli/accuracy/settings.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>

namespace raymill::client {
namespace {

using nlohmann::json;

template <typename... Values>
std::string formatted(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

double ratio(std::uint64_t part, std::uint64_t whole) {
  return whole > 0 ? static_cast<double>(part) / static_cast<double>(whole) : 0;
}

// Rays that can be judged.
std::uint64_t judged(const Setting& setting) { return setting.answers.rays - setting.answers.invalid; }

json error_json(const ErrorFigures& error) {
  return {{"median", error.median}, {"p99", error.p99}, {"max", error.most}};
}

// A store's name in the table's first column.
std::string short_name(const std::string& store) {
  constexpr std::size_t kMost = 18;
  const std::string stem = std::filesystem::path(store).stem().string();
  return stem.size() <= kMost ? stem : stem.substr(0, kMost - 1) + "~";
}

std::string share_text(std::uint64_t part, std::uint64_t whole) {
  return part == 0 ? "0" : formatted("%.2g", ratio(part, whole));
}

// "0.1", or "0.001 t" of a cone.
std::string tolerance_text(const Manner& manner) {
  const std::string length = manner.tolerance > 0 ? formatted("%g", manner.tolerance) : std::string();
  const std::string angle = manner.tolerance_angle > 0 ? formatted("%gt", manner.tolerance_angle) : std::string();
  return length.empty() ? angle : angle.empty() ? length : length + "," + angle;
}

std::string error_text(const ErrorFigures& error) {
  return formatted("%9.3g %9.3g %9.3g", error.median, error.p99, error.most);
}

}  // namespace

ErrorFigures error_figures(const Spread& spread) { return {spread.at(0.5), spread.at(0.99), spread.most()}; }

AnswerFigures answer_figures(const Tally& tally) {
  return {.rays = tally.rays(),
          .invalid = tally.invalid(),
          .oracle_hits = tally.oracle_hits(),
          .wrong_misses = tally.wrong_misses(),
          .wrong_hits = tally.wrong_hits(),
          .wrong_primitives = tally.wrong_primitives(),
          .wrong_surfaces = tally.wrong_surfaces(),
          .proxy_hits = tally.proxy_hits(),
          .inside = tally.inside(),
          .leaks = tally.leaks(),
          .t_ulps = error_figures(tally.t_ulps()),
          .t_units = error_figures(tally.t_units())};
}

double Manner::bound(const Truth& truth) const {
  return approximates() ? std::max(tolerance, tolerance_angle * truth.t * truth.dir_length)
                        : std::numeric_limits<double>::infinity();
}

std::string manner_text(const Manner& manner) {
  std::string text(to_string(manner.mode));
  if (manner.tolerance > 0) {
    text += formatted(" +-%g", manner.tolerance);
  }
  if (manner.tolerance_angle > 0) {
    text += formatted(" +-%gt", manner.tolerance_angle);
  }
  return text;
}

const Setting* fastest_within(std::span<const Setting> settings, const Demand& demand) {
  const Setting* best = nullptr;
  for (const Setting& setting : settings) {
    const bool good =
        static_cast<double>(setting.wrong_answers()) <= demand.wrong_share * static_cast<double>(judged(setting)) &&
        setting.answers.t_units.most <= demand.tolerance;
    if (good && (best == nullptr || setting.rate() > best->rate())) {
      best = &setting;
    }
  }
  return best;
}

std::vector<std::size_t> pareto_front(std::span<const Setting> settings) {
  std::vector<std::size_t> order(settings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto error = [&](std::size_t i) { return settings[i].answers.t_units.most; };
  const auto rate = [&](std::size_t i) { return settings[i].rate(); };
  // Fastest first; of equally fast ones the most exact.
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return rate(a) != rate(b) ? rate(a) > rate(b) : error(a) < error(b); });
  std::vector<std::size_t> front;
  for (const std::size_t i : order) {
    if (front.empty() || error(i) < error(front.back())) {
      front.push_back(i);
    }
  }
  std::reverse(front.begin(), front.end());
  return front;
}

json setting_json(const Setting& setting) {
  const AnswerFigures& answers = setting.answers;
  const std::vector<double>& rates = setting.mega_rays_per_second;
  return {{"store", setting.store},
          {"positions", setting.positions},
          {"mode", std::string(to_string(setting.manner.mode))},
          {"tolerance", setting.manner.tolerance},
          {"tolerance_angle", setting.manner.tolerance_angle},
          {"mrays_per_second", {{"median", setting.rate()}, {"least", rates.front()}, {"most", rates.back()}}},
          {"triangles", setting.triangles},
          {"store_bytes_per_triangle", ratio(setting.store_bytes, setting.triangles)},
          {"decoded_bytes_per_triangle", ratio(setting.decoded_bytes, setting.triangles)},
          {"bytes_read", setting.bytes_read},
          {"wrong_misses", answers.wrong_misses},
          {"wrong_hits", answers.wrong_hits},
          {"wrong_surfaces", answers.wrong_surfaces},
          {"proxy_hits", answers.proxy_hits},
          {"proxy_hit_rate", ratio(answers.proxy_hits, judged(setting))},
          {"wrong_answer_rate", ratio(setting.wrong_answers(), judged(setting))},
          {"wrong_primitives", answers.wrong_primitives},
          {"wrong_primitive_rate", ratio(answers.wrong_primitives, judged(setting))},
          {"t_error_ulps", error_json(answers.t_ulps)},
          {"t_error_units", error_json(answers.t_units)},
          {"rays_from_inside", answers.inside},
          {"leaks", answers.leaks}};
}

std::string settings_text(std::span<const Setting> settings, bool closed) {
  std::string text = formatted("%-18s %-20s %-10s %9s %8s %7s %9s %9s %9s %9s %9s  %-29s  %-29s%s\n", "", "", "", "",
                               "", "B a", "MiB", "wrong hit", "another", "wrong", "by", "error of t, ulp",
                               "error of t, scene units", closed ? "     rays" : "");
  text += formatted("%-18s %-20s %-10s %9s %8s %7s %9s %9s %9s %9s %9s  %9s %9s %9s  %9s %9s %9s%s\n", "store",
                    "positions", "mode", "tolerance", "Mrays/s", "tri", "read", "or miss", "surface", "primitive",
                    "proxy", "median", "p99", "max", "median", "p99", "max", closed ? "   inside     leaks" : "");
  for (const Setting& setting : settings) {
    const AnswerFigures& answers = setting.answers;
    const std::uint64_t of = judged(setting);
    text += formatted("%-18s %-20s %-10s %9s %8.3f %7.2f %9.1f %9s %9s %9s %9s  ", short_name(setting.store).c_str(),
                      setting.positions.c_str(), std::string(to_string(setting.manner.mode)).c_str(),
                      tolerance_text(setting.manner).c_str(), setting.rate(),
                      ratio(setting.store_bytes, setting.triangles), static_cast<double>(setting.bytes_read) / 0x1p20,
                      share_text(answers.wrong_misses + answers.wrong_hits, of).c_str(),
                      share_text(answers.wrong_surfaces, of).c_str(), share_text(answers.wrong_primitives, of).c_str(),
                      share_text(answers.proxy_hits, of).c_str());
    text += error_text(answers.t_ulps) + "  " + error_text(answers.t_units);
    if (closed) {
      text += formatted("%9llu %9llu", static_cast<unsigned long long>(answers.inside),
                        static_cast<unsigned long long>(answers.leaks));
    }
    text += "\n";
  }
  return text;
}

std::string choice_text(std::span<const Setting> settings, const Demand& demand) {
  const Setting* best = fastest_within(settings, demand);
  const std::string bound = formatted("within %g", demand.tolerance);
  const bool strict = demand.wrong_share == 0;
  const std::string share = formatted("%g", demand.wrong_share);
  if (best == nullptr) {
    return bound + ": none of these; each has " +
           (strict ? "a wrong hit or miss" : "more than " + share + " of its rays a wrong hit or miss") +
           ", or an error of t larger than that\n";
  }
  std::string words = " --mode " + std::string(to_string(best->manner.mode));
  if (best->manner.tolerance > 0) {
    words += formatted(" --tolerance %g", best->manner.tolerance);
  }
  if (best->manner.tolerance_angle > 0) {
    words += formatted(" --tolerance-angle %g", best->manner.tolerance_angle);
  }
  return bound + ":" + words + " on " + best->store + " (" + best->positions + "), the fastest " +
         (strict ? "without a wrong hit or miss" : "with at most " + share + " of its rays a wrong hit or miss") +
         " and with no error of t larger than that\n";
}

}  // namespace raymill::client
