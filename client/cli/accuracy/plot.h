// A plot of settings: rate to the right, the largest error of t upwards by its logarithm, a line through those that
// none beats. Drawn without any library, so that it looks the same everywhere. Pure functions.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "client/cli/parse.h"

namespace raymill::client {

struct PlotPoint {
  std::string label;
  double rate = 0;           ///< million rays per second, above 0
  double error = 0;          ///< scene units, from 0
  bool is_sound = true;      ///< filled; else hollow: some hit or miss is wrong
  bool is_on_front = false;  ///< of those that none beats
};

constexpr Extent kPlotExtent{960, 640};

enum class Ink : std::uint8_t { paper, grid, axis, text, front, point };

/// The colours of a pixel, red, green, blue in [0, 1].
std::array<float, 3> colour_of(Ink ink);

/// kPlotExtent.height rows of kPlotExtent.width pixels from the top.
std::vector<Ink> draw_plot(std::span<const PlotPoint> points);

}  // namespace raymill::client
