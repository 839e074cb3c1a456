// What the verbs print: reports as JSON objects, and the same as text. Pure functions.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "client/cpp/client.h"
#include "storage/io/build_store.h"
#include "storage/io/store_costs.h"
#include "traversal/service.h"

namespace raymill::client {

/// Where a run's time went.
struct RunTimes {
  double open_seconds = 0;
  double input_seconds = 0;
  double output_seconds = 0;
};

/// The object that `--stats` writes.
nlohmann::json stats_json(const JobStats& stats, const RunTimes& times, std::uint64_t memory_bytes, unsigned threads);
/// One line for people: rays, hits, rate, pages.
std::string stats_text(const JobStats& stats);

/// What `info` knows beside the store's own figures.
struct InfoExtras {
  std::vector<FeatureCost> costs;    ///< none: the store is on a server
  std::vector<std::string> kernels;  ///< by which each query is answered here, e.g. "any/mbvh8/bits128/watertight/avx2"
};
nlohmann::json info_json(const StoreInfo& info, const InfoExtras& extras);
std::string info_text(const StoreInfo& info, const InfoExtras& extras);

nlohmann::json build_json(const BuildReport& report, const std::string& output);
std::string build_text(const BuildReport& report, const std::string& output);

nlohmann::json job_json(const JobInfo& job);
std::string job_text(const JobInfo& job);

}  // namespace raymill::client
