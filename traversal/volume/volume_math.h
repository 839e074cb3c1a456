// Exponential and logarithm that give the same bits on every machine: the C library's may not, they differ between
// processors. Sums and products in float64 alone, no contraction. Stateless.
#pragma once

#include <array>
#include <bit>
#include <cstdint>

namespace raymill::traversal {

/// e^-x for x >= 0 to within 2 ulp of float64; 0 beyond 700.
inline double exp_of_minus(double x) {
  if (!(x <= 700)) {
    return 0;
  }
  // x = k ln 2 - r with |r| <= ln 2 / 2; e^-x = 2^-k e^r. ln 2 in two parts, the first with 20 zero bits at its end.
  constexpr double kInverseLn2 = 1.4426950408889634, kLn2High = 0x1.62e42fee00000p-1, kLn2Low = 0x1.a39ef35793c76p-33;
  const auto k = static_cast<std::int64_t>(x * kInverseLn2 + 0.5);
  const double r = double(k) * kLn2High - x + double(k) * kLn2Low;
  // Taylor: the first term left out is below 2^-57.
  double sum = 1;
  for (int n = 13; n > 0; --n) {
    sum = 1 + r * sum / n;
  }
  return sum * std::bit_cast<double>(static_cast<std::uint64_t>(1023 - k) << 52);
}

/// -ln x for 0 < x <= 1 to within a few ulp of float64.
inline double minus_log(double x) {
  auto bits = std::bit_cast<std::uint64_t>(x);
  int exponent = static_cast<int>(bits >> 52) - 1023;
  bits = (bits & 0xFFFFFFFFFFFFFULL) | 0x3FF0000000000000ULL;
  double m = std::bit_cast<double>(bits);  // 1 <= m < 2
  if (m > 1.4142135623730951) {
    m *= 0.5;
    ++exponent;
  }
  // ln m = 2 artanh f, f = (m - 1) / (m + 1), |f| <= 0.1716; the first term left out is below 2^-57.
  const double f = (m - 1) / (m + 1), square = f * f;
  double sum = 0;
  for (int n = 21; n > 0; n -= 2) {
    sum = sum * square + 1.0 / n;
  }
  constexpr double kLn2 = 0.6931471805599453;
  return -(double(exponent) * kLn2 + 2 * f * sum);
}

/// A good mix of 64 bits (Steele, Lea, Flood 2014: SplitMix64).
constexpr std::uint64_t mix(std::uint64_t x) {
  x += 0x9E3779B97F4A7C15ULL;
  x = (x ^ x >> 30) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ x >> 27) * 0x94D049BB133111EBULL;
  return x ^ x >> 31;
}

/// A number in [0, 1) by its place in a sequence: drawn in any order, the same each time.
constexpr double uniform(std::uint64_t key, std::uint64_t place) {
  return double(mix(key ^ mix(place)) >> 11) * 0x1p-53;
}

}  // namespace raymill::traversal
