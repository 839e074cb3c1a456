// Gradient noise over the plane and sums of its octaves. Pure functions.
#pragma once

#include <cstdint>

namespace raymill::client {

/// Perlin's gradient noise with the quintic fade (Perlin 2002): about [-1, 1], zero at whole coordinates, smooth.
float noise(std::uint64_t seed, float x, float z);

/// Octaves of noise, each of half the wavelength and half the height of the one before.
float fractal(std::uint64_t seed, float x, float z, int octaves);

/// The same with creases where noise changes its sign, and finer octaves weighted by the coarser ones: mountains
/// (Musgrave's ridged multifractal). About [0, 1].
float ridged(std::uint64_t seed, float x, float z, int octaves);

}  // namespace raymill::client
