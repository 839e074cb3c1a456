#include "client/cli/generate/noise.h"

#include <algorithm>
#include <cmath>

#include "client/cli/random.h"

namespace raymill::client {

namespace {

// One of eight directions, by the hash of a lattice point.
float gradient(std::uint64_t seed, std::int64_t ix, std::int64_t iz, float x, float z) {
  const std::uint64_t point =
      static_cast<std::uint64_t>(ix) * 0x9E3779B97F4A7C15u + static_cast<std::uint64_t>(iz) * 0xC2B2AE3D27D4EB4Fu;
  const std::uint64_t hash = mix(seed ^ point) >> 61;
  const float a = (hash & 4) != 0 ? z : x;
  const float b = (hash & 4) != 0 ? x : z;
  // (+-1, +-1/2): lengths are equal and no direction runs along an axis.
  return ((hash & 1) != 0 ? -a : a) + ((hash & 2) != 0 ? -0.5F : 0.5F) * b;
}

float fade(float t) { return t * t * t * (t * (t * 6 - 15) + 10); }
float mixed(float a, float b, float t) { return a + (b - a) * t; }

}  // namespace

float noise(std::uint64_t seed, float x, float z) {
  const float floor_x = std::floor(x), floor_z = std::floor(z);
  const auto ix = static_cast<std::int64_t>(floor_x), iz = static_cast<std::int64_t>(floor_z);
  const float fx = x - floor_x, fz = z - floor_z;
  const float u = fade(fx), v = fade(fz);
  return mixed(mixed(gradient(seed, ix, iz, fx, fz), gradient(seed, ix + 1, iz, fx - 1, fz), u),
               mixed(gradient(seed, ix, iz + 1, fx, fz - 1), gradient(seed, ix + 1, iz + 1, fx - 1, fz - 1), u), v);
}

float fractal(std::uint64_t seed, float x, float z, int octaves) {
  float sum = 0, height = 1;
  for (int octave = 0; octave < octaves; ++octave) {
    sum += height * noise(seed + static_cast<std::uint64_t>(octave), x, z);
    height *= 0.5F;
    x *= 2;
    z *= 2;
  }
  return sum;
}

float ridged(std::uint64_t seed, float x, float z, int octaves) {
  float sum = 0, height = 0.5F, weight = 1;
  for (int octave = 0; octave < octaves; ++octave) {
    const float crease = 1 - std::abs(noise(seed + static_cast<std::uint64_t>(octave), x, z));
    const float signal = crease * crease * weight;
    sum += height * signal;
    weight = std::clamp(signal * 1.6F, 0.0F, 1.0F);
    height *= 0.5F;
    x *= 2.03F;
    z *= 2.03F;
  }
  return sum;
}

}  // namespace raymill::client
