// What every import of any bytes must keep to.
#pragma once

#include <array>
#include <cstdlib>
#include <span>

#include "storage/import/scene_import.h"

namespace raymill::fuzz {

class ImportChecker final : public storage::TriangleSink {
 public:
  Status add(std::span<const storage::Triangle> triangles) override {
    for (const storage::Triangle& triangle : triangles) {
      if (triangle.v[0] == triangle.v[1] || triangle.v[1] == triangle.v[2] || triangle.v[2] == triangle.v[0]) {
        std::abort();  // degenerate triangles must not come through
      }
    }
    kept += triangles.size();
    return {};
  }
  std::uint64_t kept = 0;
};

/// The file `name` of these bytes is imported or refused, within a small budget, all of which is given back.
inline void check_import_about(const std::array<double, 3>& origin, const std::uint8_t* data, std::size_t size,
                               const char* name) {
  storage::ImportOptions options;
  options.origin = origin;
  storage::Ledger ledger(mebibytes(64));
  ImportChecker checker;
  storage::ImportReport report;
  const auto bytes = std::as_bytes(std::span(data, size));
  const Status status = storage::import_scene_memory(bytes, name, options, ledger, checker, report);
  std::uint64_t triangles = 0;
  for (const storage::GeometryInfo& geometry : report.geometries) {
    triangles += geometry.triangles;
  }
  const bool counted = !status.ok() || (checker.kept == report.kept && report.kept <= report.triangles);
  if (!counted || triangles != report.triangles || (!status.ok() && status.message().empty()) ||
      ledger.used_bytes(storage::Tag::build) != 0) {
    std::abort();
  }
}

/// As it stands, and relative to an origin, for which numbers are read in another way.
inline int check_import(const std::uint8_t* data, std::size_t size, const char* name) {
  check_import_about({}, data, size, name);
  check_import_about({4500000.25, 0, -1e6}, data, size, name);
  return 0;
}

}  // namespace raymill::fuzz
