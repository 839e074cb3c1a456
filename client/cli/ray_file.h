// Ray files: .npy of float32 or float64, C order, shape (N, 6) as Open3D (org, dir; tnear 0, tfar +inf) or (N, 8) as
// OptiX (org, tnear, dir, tfar). float64 is rounded as traversal/ray_rounding.h says. Both ways are streamed: a file of
// any size passes through a buffer of 64 KiB.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "client/cli/npy_rows.h"
#include "storage/base/atomic_file.h"
#include "storage/base/status.h"
#include "traversal/query.h"

namespace raymill::client {

/// Thread-confined.
class RayFileReader {
 public:
  /// Checks header and file size. Errors: not_found, io, bad_rays (a sentence that says what was found).
  static Result<RayFileReader> open(const std::string& path);

  [[nodiscard]] std::uint64_t count() const { return rows_.count(); }
  /// Whether the file's rays are float64.
  [[nodiscard]] bool is_wide() const { return value_bytes_ == sizeof(double); }
  /// Rays are read relative to it (TraceConfig::relative).
  void set_origin(const std::array<double, 3>& origin) { origin_ = origin; }
  /// Leaves out the next `rays`, at most all that are left.
  void skip(std::uint64_t rays) { rows_.skip(rays); }
  /// The next ray is the first one again.
  void rewind() { rows_.rewind(); }
  /// What tells this file from another one of the same name: size and time of the last change.
  [[nodiscard]] std::string identity() const { return rows_.identity(); }
  /// The next rays, at most rays.size(); returns how many, 0 at the end. Errors: io, bad_rays (the file shrank).
  Result<std::size_t> read(std::span<Ray> rays);
  /// The same in world space, all digits of float64.
  Result<std::size_t> read64(std::span<Ray64> rays);

 private:
  template <typename AnyRay>
  Result<std::size_t> read_rows(std::span<AnyRay> rays);
  RayFileReader(NpyRows rows, unsigned columns, unsigned value_bytes)
      : rows_(std::move(rows)), columns_(columns), value_bytes_(value_bytes) {}

  NpyRows rows_;
  unsigned columns_;
  unsigned value_bytes_;
  std::array<double, 3> origin_{};
};

/// Writes a (count, 8) ray file of float32; of float64 where the rays are relative to an origin that is not zero: what
/// it holds is in world space, rounded once to float64. Thread-confined.
class RayFileWriter {
 public:
  /// `shuffle_seed` not null: ray i goes to a place that a permutation of [0, count) chosen by the seed gives it.
  static Result<RayFileWriter> create(const std::string& path, std::uint64_t count, const std::uint64_t* shuffle_seed);
  /// Of the rays to come; before the first.
  Status set_origin(const std::array<double, 3>& origin);
  /// Appends rays in order; more than `count` in all is a mistake of the caller. Errors: disk_full, io.
  Status append(std::span<const Ray> rays);
  /// Gives the file its name; needs exactly `count` rays appended.
  Status commit();
  [[nodiscard]] std::uint64_t missing() const { return count_ - written_; }

 private:
  RayFileWriter(storage::AtomicFile file, std::uint64_t count) : file_(std::move(file)), count_(count) {}
  Status begin();
  Status flush();
  [[nodiscard]] bool is_wide() const { return origin_ != std::array<double, 3>{}; }

  storage::AtomicFile file_;
  std::vector<std::byte> buffer_;  ///< in order only
  std::array<double, 3> origin_{};
  std::uint64_t count_ = 0;
  std::uint64_t written_ = 0;
  std::uint64_t data_offset_ = 0;
  bool shuffled_ = false;
  std::uint64_t seed_ = 0;
};

}  // namespace raymill::client
