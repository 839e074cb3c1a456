// TriangleFilter: sorts out the triangles that no ray could hit, exactly, and hands the rest on in pieces.
//
// A triangle is degenerate when two corners are equal or its area is zero in exact arithmetic; nothing is judged by an
// epsilon. Thread-confined.
#pragma once

#include <cstdint>
#include <vector>

#include "storage/base/vec3.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

enum class TriangleVerdict : std::uint8_t { keep, not_finite, out_of_range, degenerate };

TriangleVerdict judge(const std::array<Vec3f, 3>& corners);

/// Collects the triangles of one geometry after the other.
class TriangleWriter {
 public:
  /// Triangles handed on at once.
  static constexpr std::size_t kPieceTriangles = 16384;
  static constexpr std::uint64_t kPulse = 1 << 16;

  /// What is known of a geometry's faces under masks.
  struct Faces {
    MaskSink* sink = nullptr;
    std::uint64_t first = GeometryMask::kNoFaces;  ///< face of primitive 0; none: no triangle is cut out by itself
    std::uint64_t count = 0;
    bool all_cut = false;  ///< nothing is left of any triangle
  };

  TriangleWriter(TriangleSink& sink, ImportReport& report);

  /// Later triangles belong to the last entry of report.geometries.
  void begin_geometry() { resume_geometry(report_.geometries.size() - 1); }
  /// Later triangles belong to that entry of report.geometries, after those that it has.
  void resume_geometry(std::size_t entry) { set_geometry(entry, report_.geometries[entry].geometry_id); }
  /// The same under an id that is not the entry's own: of an object, or of a copy.
  void set_geometry(std::size_t entry, std::uint32_t geometry_id) {
    entry_ = entry;
    geometry_id_ = geometry_id;
    primitive_id_ = report_.geometries[entry].triangles;
    faces_ = {};
    read_faces_.clear();
  }
  /// Later triangles are the geometry's from its first on, once more.
  void begin_copy(std::size_t entry, std::uint32_t geometry_id) {
    set_geometry(entry, geometry_id);
    primitive_id_ = 0;
  }
  /// Of the triangles that come until another geometry is begun.
  void set_faces(const Faces& faces) { faces_ = faces; }
  /// Judges the next triangle of the geometry. Errors: the sink's, unsupported (more triangles than primitive ids).
  Status add(const std::array<Vec3f, 3>& corners);
  /// Hands on what is left. Errors: the sink's.
  Status flush() { return piece_.empty() ? Status() : hand_on(); }
  /// Between triangles, for each vertex or row that gives none: the sink is asked once in kPulse whether to go on.
  /// Errors: the sink's.
  Status pulse() { return ++pulses_ % kPulse == 0 ? hand_on() : Status(); }
  /// True once the sink has failed: its error is then the import's, word for word.
  [[nodiscard]] bool sink_failed() const { return sink_failed_; }

  /// What the writer holds, for the claim.
  static constexpr std::uint64_t heap_bytes() {
    return kPieceTriangles * sizeof(Triangle) + kFacePiece * sizeof(FaceMask);
  }

 private:
  static constexpr std::size_t kFacePiece = 1024;
  Status hand_on();
  Result<bool> is_cut(std::uint32_t primitive_id);

  TriangleSink& sink_;
  ImportReport& report_;
  std::vector<Triangle> piece_;
  std::size_t entry_ = 0;
  std::uint32_t geometry_id_ = 0;
  std::uint64_t primitive_id_ = 0;
  Faces faces_;
  std::vector<FaceMask> read_faces_;  // in a row
  std::uint64_t first_read_ = 0;
  bool sink_failed_ = false;
  std::uint64_t pulses_ = 0;
};

}  // namespace raymill::storage
