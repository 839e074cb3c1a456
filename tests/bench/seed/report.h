// The tables of one file of rays, for people and as a line of JSON.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tests/bench/seed/kernels.h"
#include "tests/bench/seed/resident_rays.h"

namespace raymill::bench {

/// An algorithm on a file of rays.
struct Measured {
  std::vector<double> rates;      ///< million rays a second, one for each repetition
  std::vector<double> overheads;  ///< percent more time than the stack of its width took in the same repetition
  Counters counters;
  ResidentRays resident;
  std::size_t different = 0;  ///< hits that are not the first algorithm's
};

struct Run {
  std::string store, rays_file;  ///< their names, without folder and extension
  std::size_t rays = 0;
  std::size_t triangles = 0;  ///< of the scene
  std::vector<Algorithm> algorithms;
  std::vector<Measured> measured;  ///< of each algorithm
};

/// The middle one of `values`, which are not empty.
double median(std::vector<double> values);
void print_tables(const Run& run);
nlohmann::json line_of(const Run& run);

}  // namespace raymill::bench
