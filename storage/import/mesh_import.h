// MeshImport: what the readers of PLY, OBJ and STL share. Thread-confined.
#pragma once

#include <string>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/byte_source.h"
#include "storage/import/scene_import.h"
#include "storage/import/triangle_filter.h"

namespace raymill::storage {

struct MeshImport {
  const ByteSource& file;
  const std::string& name;  ///< of the file, for the report
  Ledger& ledger;
  TriangleWriter& out;
  ImportReport& report;
  std::array<double, 3> origin{};  ///< subtracted from every position
};

/// Longest name of a node or mesh that is taken from a file; what is longer is cut.
constexpr std::size_t kMostNameBytes = 128;
/// Geometries that one file's groups and solids may make: their names stay in memory until the store is written.
constexpr std::size_t kMostFileGeometries = 65536;

/// Adds the next geometry to the report and gives its triangles to it. Errors: unsupported (kMostFileGeometries of
/// `of_this_file` are there already).
Status begin_geometry(const MeshImport& import, std::size_t of_this_file, const std::string& node,
                      const std::string& mesh);
/// For a file that holds points and no face. Errors: unsupported, always.
Status only_points(std::uint64_t vertices);

/// PLY 1.0. One geometry; the vertices (12 bytes each) are held and claimed, faces flow through.
/// Errors: bad_scene, unsupported, budget_exceeded, io, and the sink's.
Status import_ply(const MeshImport& import);
/// Wavefront OBJ. A geometry for each object, group and material that faces are given under, in the order of their
/// first faces; the vertices are held and claimed, faces flow through. Errors: as above.
Status import_obj(const MeshImport& import);
/// STL of numbers and of words. One geometry for each solid; nothing is held. Errors: as above.
Status import_stl_binary(const MeshImport& import);
Status import_stl_text(const MeshImport& import);

}  // namespace raymill::storage
