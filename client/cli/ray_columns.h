// What rays bring beside a ray file: .npy of uint32, C order, a row for each ray. Streamed.
//
//   skip    (N, 2)  geometry_id and primitive_id of what the ray passes through; 4294967295 for nothing
//   masks   (N,)    bits of the ray
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "client/cli/npy_rows.h"
#include "storage/base/status.h"
#include "traversal/service.h"

namespace raymill::client {

/// A file of rows, each a PrimitiveIds or a std::uint32_t. Thread-confined.
template <typename Row>
class RayColumn {
 public:
  /// `what` is in the rows, for messages; `most_rays`: of a read, at most. Errors: not_found, io, bad_rays (not such a
  /// file, or not of so many rays).
  static Result<RayColumn> open(const std::string& path, const std::string& what, std::uint64_t ray_count,
                                std::size_t most_rays);

  void skip(std::uint64_t rays) { rows_.skip(rays); }
  [[nodiscard]] std::string identity() const { return rows_.identity(); }
  /// Of the next `rays`, of which there must be so many; until the next call. Errors: io, bad_rays (the file shrank).
  Result<std::span<const Row>> read(std::size_t rays);

 private:
  RayColumn(NpyRows rows, std::size_t most_rays) : rows_(std::move(rows)), values_(most_rays) {}

  NpyRows rows_;
  std::vector<Row> values_;
};

extern template class RayColumn<PrimitiveIds>;
extern template class RayColumn<std::uint32_t>;

/// All that a file of rays has beside it. Thread-confined.
class RayColumns {
 public:
  struct Paths {
    std::string skip, masks;  ///< empty: none
  };
  /// Errors: those of the columns.
  static Result<RayColumns> open(const Paths& paths, std::uint64_t ray_count, std::size_t most_rays);

  /// Leaves out those of the next `rays`.
  void skip(std::uint64_t rays);
  /// What tells these files from others.
  [[nodiscard]] std::string identity() const;
  /// Of the next `rays`; until the next call.
  Result<RayExtras> read(std::size_t rays);

 private:
  std::optional<RayColumn<PrimitiveIds>> skipped_;
  std::optional<RayColumn<std::uint32_t>> masks_;
};

/// The masks of geometries: .npy of uint32, shape (G,). Errors: not_found, io, bad_rays.
Result<std::vector<std::uint32_t>> read_geometry_masks(const std::string& path);

}  // namespace raymill::client
