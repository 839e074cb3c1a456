// What every import of any bytes must keep to.
#pragma once

#include <array>
#include <cstdlib>
#include <span>

#include "storage/import/scene_import.h"

namespace raymill::fuzz {

class ImportChecker final : public storage::TriangleSink, public storage::PartSink {
 public:
  void enter_part(std::uint32_t part) override {
    if (part != storage::kNoPart && part > 0) {
      std::abort();  // there is one
    }
  }
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

class AttributeChecker final : public storage::AttributeSink {
 public:
  Result<std::uint64_t> add_entries(std::span<const float> entries) override {
    constexpr std::size_t kFloats = 3 * storage::kMostCornerFloats;
    if (entries.empty() || entries.size() % kFloats != 0) {
      std::abort();
    }
    const std::uint64_t first = count_;
    count_ += entries.size() / kFloats;
    return first;
  }
  Status set_attributes(std::uint32_t geometry_id, const storage::AttributeGeometry& geometry) override {
    const bool rises = next_id_ <= geometry_id;
    next_id_ = geometry_id + std::uint64_t{1};
    if (!rises || geometry.present == 0 || geometry.triangle_count == 0 ||
        geometry.first_entry + geometry.triangle_count > count_) {
      std::abort();
    }
    return {};
  }

 private:
  std::uint64_t count_ = 0, next_id_ = 0;
};

/// The file `name` of these bytes is imported or refused, within a small budget, all of which is given back.
inline void check_import_about(const std::array<double, 3>& origin, const std::uint8_t* data, std::size_t size,
                               const char* name, storage::AttributeSet attributes) {
  AttributeChecker attribute_checker;
  storage::ImportOptions options;
  options.attributes = attributes;
  options.attribute_sink = &attribute_checker;
  options.origin = origin;
  storage::Ledger ledger(mebibytes(64));
  ImportChecker checker;
  // A part far out: by what accessors say of their least and most, nodes' meshes are in it or not.
  const std::array<storage::ScenePart, 1> parts{
      {{{{1e6, -1e9, -1e9}, {1e9, 1e9, 1e9}}, storage::origin_near({4e6, 0, 0}, 0)}}};
  options.parts = parts;
  options.part_sink = &checker;
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

/// As it stands; and with attributes, relative to an origin, for which numbers are read in another way.
inline int check_import(const std::uint8_t* data, std::size_t size, const char* name) {
  check_import_about({}, data, size, name, 0);
  check_import_about({4500000.25, 0, -1e6}, data, size, name, storage::kAllAttributes);
  return 0;
}

}  // namespace raymill::fuzz
