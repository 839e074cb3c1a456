// Files of primitives that rays pass through: .npy of uint32, C order, shape (N, 2): geometry_id, primitive_id for each
// ray of a ray file; 4294967295 for none. Streamed.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "client/cli/npy_rows.h"
#include "storage/base/status.h"
#include "traversal/query.h"

namespace raymill::client {

/// Thread-confined.
class SkipFileReader {
 public:
  /// `most_rays`: of a read, at most. Errors: not_found, io, bad_rays (not such a file, or not of so many rays).
  static Result<SkipFileReader> open(const std::string& path, std::uint64_t ray_count, std::size_t most_rays);

  /// Leaves out those of the next `rays`.
  void skip(std::uint64_t rays) { rows_.skip(rays); }
  [[nodiscard]] std::string identity() const { return rows_.identity(); }
  /// Of the next `rays`, of which there must be so many; until the next call. Errors: io, bad_rays (the file shrank).
  Result<std::span<const PrimitiveIds>> read(std::size_t rays);

 private:
  SkipFileReader(NpyRows rows, std::size_t most_rays) : rows_(std::move(rows)), ids_(most_rays) {}

  NpyRows rows_;
  std::vector<PrimitiveIds> ids_;
};

}  // namespace raymill::client
