#include "tests/bench/seed/report.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "tests/bench/seed/states.h"

namespace raymill::bench {
namespace {

// Of the state, what the ray with the fullest stack would have kept.
std::size_t most_used_bytes(const Algorithm& algorithm, const Counters& counters) {
  if (algorithm.name != kStackName) {
    return algorithm.state_bytes;
  }
  return sizeof(StackState<2>::reference) + sizeof(StackState<2>::count) + counters.most_entries * sizeof(StackEntry);
}

double per_ray(std::uint64_t sum, const Run& run) { return static_cast<double>(sum) / static_cast<double>(run.rays); }

double percent_of_nodes(const Counters& counters, unsigned children) {
  return 100 * static_cast<double>(counters.children_hit[children]) / static_cast<double>(counters.nodes);
}

bool is_in_histogram(const Algorithm& algorithm) { return algorithm.name == kStackName && algorithm.width > 2; }

void print_speeds(const Run& run) {
  std::printf("%-22s %3s  %8s  %10s  %8s  %10s  %9s  %13s\n", "algorithm", "N", "state B", "most used", "Mrays/s",
              "overhead %", "nodes/ray", "triangles/ray");
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    const Algorithm& algorithm = run.algorithms[i];
    const Measured& its = run.measured[i];
    std::printf("%-22s %3u  %8zu  %10zu  %8.3f  %10.1f  %9.1f  %13.1f\n", algorithm.name.c_str(), algorithm.width,
                algorithm.state_bytes, most_used_bytes(algorithm, its.counters), median(its.rates),
                median(its.overheads), per_ray(its.counters.nodes, run), per_ray(its.counters.triangles, run));
  }
}

void print_histogram(const Run& run) {
  std::printf("\nchildren hit, %% of the nodes that the stack visits\n%-3s", "N");
  for (unsigned children = 0; children <= 16; ++children) {
    std::printf("  %5u", children);
  }
  std::printf("\n");
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    if (!is_in_histogram(run.algorithms[i])) {
      continue;
    }
    std::printf("%-3u", run.algorithms[i].width);
    for (unsigned children = 0; children <= run.algorithms[i].width; ++children) {
      std::printf("  %5.2f", percent_of_nodes(run.measured[i].counters, children));
    }
    std::printf("\n");
  }
}

void print_resident(const Run& run) {
  std::printf("\n%-22s %3s  %8s  %9s  %12s\n", "rays in 128 MiB", "N", "record B", "grown MiB", "thousands");
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    const ResidentRays& resident = run.measured[i].resident;
    std::printf("%-22s %3u  %8zu  %9.2f  %12.0f\n", run.algorithms[i].name.c_str(), run.algorithms[i].width,
                run.algorithms[i].record_bytes, static_cast<double>(resident.grown_bytes) / (1U << 20),
                resident.rays / 1e3);
  }
}

}  // namespace

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

void print_tables(const Run& run) {
  std::printf("%s, %s: %zu triangles, %zu rays, closest hit, %s\n\n", run.store.c_str(), run.rays_file.c_str(),
              run.triangles, run.rays, isa_of_algorithms().c_str());
  print_speeds(run);
  print_histogram(run);
  print_resident(run);
  std::printf("\n");
  std::fflush(stdout);
}

nlohmann::json line_of(const Run& run) {
  nlohmann::json line{{"name", "closest_hit/seed/" + isa_of_algorithms() + "/" + run.store + "/" + run.rays_file},
                      {"rays", run.rays},
                      {"triangles", run.triangles},
                      {"algorithms", nlohmann::json::array()}};
  for (std::size_t i = 0; i < run.algorithms.size(); ++i) {
    const Algorithm& algorithm = run.algorithms[i];
    const Measured& its = run.measured[i];
    nlohmann::json row{{"name", algorithm.name},
                       {"width", algorithm.width},
                       {"state_bytes", algorithm.state_bytes},
                       {"most_used_state_bytes", most_used_bytes(algorithm, its.counters)},
                       {"record_bytes", algorithm.record_bytes},
                       {"rays_in_128_mib", its.resident.rays},
                       {"mrays_per_second", median(its.rates)},
                       {"overhead_percent", median(its.overheads)},
                       {"nodes_per_ray", per_ray(its.counters.nodes, run)},
                       {"triangles_per_ray", per_ray(its.counters.triangles, run)},
                       {"different", its.different}};
    for (unsigned children = 0; is_in_histogram(algorithm) && children <= algorithm.width; ++children) {
      row["children_hit_percent"].push_back(percent_of_nodes(its.counters, children));
    }
    line["algorithms"].push_back(row);
  }
  return line;
}

}  // namespace raymill::bench
