// Lattice: positions as multiples of one power-of-two step, the same for all flattened geometry.
//
// A coordinate is rounded to the nearest multiple (ties to even) once, before anything is built, so a vertex that two
// triangles, pages or objects share stays one position and no crack opens. Thread-confined: it counts what it does.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "storage/base/status.h"
#include "storage/base/vec3.h"

namespace raymill::storage {

/// What `--positions` asks for.
struct PositionsRequest {
  enum class Kind : std::uint8_t { float32, lattice_step, lattice_bits };
  Kind kind = Kind::float32;
  double step = 0;    ///< scene units; rounded down to a power of two
  unsigned bits = 0;  ///< 2^bits steps span the largest extent of the scene
};

/// "float32", "lattice:STEP" or "lattice:BITSb". Errors: invalid_argument.
Result<PositionsRequest> parse_positions(const std::string& text);

class Lattice {
 public:
  enum class Outcome : std::uint8_t { kept, degenerate, out_of_range };

  /// float32: every position stays as it is.
  Lattice() = default;
  /// `box`: of all corners, which lattice_bits measures.
  Lattice(const PositionsRequest& request, const Aabb& box);

  [[nodiscard]] bool active() const { return active_; }
  [[nodiscard]] std::int32_t step_exponent() const { return step_exponent_; }
  /// Of a vertex so far, scene units.
  [[nodiscard]] double max_displacement() const { return max_displacement_; }
  /// Root of the mean square over the corners of all triangles so far, scene units; the same in whatever order they
  /// came, for their squares are summed as whole numbers.
  [[nodiscard]] double rms_displacement() const;
  /// Puts the corners on the lattice. A triangle that is out of range is left half done.
  Outcome snap(Triangle& t);
  /// The sentence for a triangle that was out of range: invalid_argument.
  [[nodiscard]] Status out_of_range(const Triangle& t) const;

 private:
  bool active_ = false;
  std::int32_t step_exponent_ = 0;
  double step_ = 1;
  double max_displacement_ = 0;
  std::uint64_t squares_ = 0;  // of displacements, in 2^-28 square steps
  std::uint64_t corners_ = 0;
};

struct LatticeResult {
  std::int32_t step_exponent = 0;
  double max_displacement = 0;           ///< of a vertex, scene units
  std::uint64_t dropped_degenerate = 0;  ///< triangles that the lattice made degenerate; they are taken out
};

/// Puts all corners of a scene in memory on the lattice. Errors: invalid_argument when a coordinate is more than 2^31
/// steps from zero.
Result<LatticeResult> snap_to_lattice(const PositionsRequest& request, std::vector<Triangle>& triangles);

}  // namespace raymill::storage
