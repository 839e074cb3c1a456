// Settings, each a mode and a store, as they were measured: what they cost, what their answers are worth, and which of
// them is the one to take. Pure functions.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "client/cli/accuracy/tally.h"
#include "traversal/query.h"

namespace raymill::client {

/// How an error is spread over the rays that were hits of both.
struct ErrorFigures {
  double median = 0;
  double p99 = 0;
  double most = 0;
};
ErrorFigures error_figures(const Spread& spread);

/// What a Tally came to, without its memory.
struct AnswerFigures {
  std::uint64_t rays = 0;
  std::uint64_t invalid = 0;
  std::uint64_t oracle_hits = 0;
  std::uint64_t wrong_misses = 0;
  std::uint64_t wrong_hits = 0;
  std::uint64_t wrong_primitives = 0;
  std::uint64_t wrong_surfaces = 0;
  std::uint64_t proxy_hits = 0;
  std::uint64_t inside = 0;
  std::uint64_t leaks = 0;
  ErrorFigures t_ulps;
  ErrorFigures t_units;
};
AnswerFigures answer_figures(const Tally& tally);

/// Settings differ in these beside the store.
struct Manner {
  Mode mode = Mode::watertight;
  double tolerance = 0;        ///< TraceConfig::tolerance
  double tolerance_angle = 0;  ///< TraceConfig::tolerance_angle
  bool operator==(const Manner&) const = default;

  [[nodiscard]] bool approximates() const { return tolerance > 0 || tolerance_angle > 0; }
  /// The error that it allows a hit at the truth, in scene units: without a tolerance any.
  [[nodiscard]] double bound(const Truth& truth) const;
};

struct Setting {
  std::string store;      ///< as it was named
  std::string positions;  ///< "float32" or "lattice:STEP"
  Manner manner;
  std::uint64_t triangles = 0;
  std::uint64_t store_bytes = 0;
  std::uint64_t decoded_bytes = 0;
  std::uint64_t bytes_read = 0;              ///< of pages, by a run that finds none in memory
  std::vector<double> mega_rays_per_second;  ///< one for each round, sorted
  AnswerFigures answers;

  [[nodiscard]] double rate() const { return mega_rays_per_second[mega_rays_per_second.size() / 2]; }  ///< the median
  [[nodiscard]] std::uint64_t wrong_answers() const {
    return answers.wrong_misses + answers.wrong_hits + answers.wrong_surfaces;
  }
};

/// What is asked of a setting that is to be chosen.
struct Demand {
  double tolerance = 0;    ///< the largest error of t, in scene units
  double wrong_share = 0;  ///< of the rays, that may be a wrong hit or miss or hit another surface
};
/// The fastest setting that keeps the demand; null where none does.
const Setting* fastest_within(std::span<const Setting> settings, const Demand& demand);

/// Places of the settings that none beats: no other is at least as fast with no larger an error of t, and better in
/// one of the two. In the order of their rates.
std::vector<std::size_t> pareto_front(std::span<const Setting> settings);

nlohmann::json setting_json(const Setting& setting);
/// A table with a line for each setting. `closed`: with leaks.
std::string settings_text(std::span<const Setting> settings, bool closed);
/// What fastest_within() says, as a sentence.
std::string choice_text(std::span<const Setting> settings, const Demand& demand);
/// A setting's manner as words for a plot's label, e.g. "watertight +-0.1".
std::string manner_text(const Manner& manner);

}  // namespace raymill::client
