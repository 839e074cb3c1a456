#include "storage/import/scene_import.h"

#include "storage/import/mesh_import.h"
#include "storage/import/message.h"
#include "storage/import/scene_format.h"

namespace raymill::storage {

namespace {

Status import_mesh_file(SceneFormat format, const MeshImport& import) {
  Status status;
  switch (format) {
    case SceneFormat::ply:
      status = import_ply(import);
      break;
    case SceneFormat::obj:
      status = import_obj(import);
      break;
    case SceneFormat::stl_text:
      status = import_stl_text(import);
      break;
    case SceneFormat::stl_binary:
      status = import_stl_binary(import);
      break;
    case SceneFormat::gltf:
      break;
  }
  return status.ok() ? import.out.flush() : status;
}

Status import_mesh(SceneFormat format, const ByteSource& file, const std::string& name, const ImportOptions& options,
                   Ledger& ledger, TriangleSink& sink, ImportReport& report) {
  if (options.scene && *options.scene != 0) {
    return {ErrorCode::invalid_argument,
            message(name, ": has no scene ", *options.scene, "; it is no glTF file and holds one")};
  }
  const auto scratch = ledger.claim(Tag::build, TriangleWriter::heap_bytes());
  if (!scratch.ok()) {
    return in_context(name, scratch.status());
  }
  TriangleWriter out(sink, report);
  Status status = import_mesh_file(format, {file, name, ledger, out, report, options.origin});
  return status.ok() || out.sink_failed() ? status : in_context(name, status);
}

}  // namespace

Status begin_geometry(const MeshImport& import, std::size_t of_this_file, const std::string& node,
                      const std::string& mesh) {
  if (of_this_file >= kMostFileGeometries) {
    return {ErrorCode::unsupported, message("has more than ", kMostFileGeometries,
                                            " groups of faces, each of which would be a geometry; join some")};
  }
  GeometryInfo& geometry = import.report.add_geometry();
  geometry.file = import.name;
  geometry.node = node;
  geometry.mesh = mesh;
  import.out.begin_geometry();
  return {};
}

Status only_points(std::uint64_t vertices) {
  return {ErrorCode::unsupported,
          message("holds ", vertices, " vertices and no faces; Raymill traces triangles, so make a mesh of it before")};
}

Status import_scene(const std::string& path, const ImportOptions& options, Ledger& ledger, TriangleSink& sink,
                    ImportReport& report) {
  RAYMILL_ASSIGN_OR_RETURN(const ByteSource file, ByteSource::open(path));
  const Result<SceneFormat> format = detect_format(file, path);
  if (!format.ok()) {
    return in_context(path, format.status());
  }
  if (*format == SceneFormat::gltf) {
    return import_gltf(path, options, ledger, sink, report);
  }
  return import_mesh(*format, file, path, options, ledger, sink, report);
}

Status import_scene_memory(std::span<const std::byte> bytes, const std::string& name, const ImportOptions& options,
                           Ledger& ledger, TriangleSink& sink, ImportReport& report) {
  const ByteSource file = ByteSource::view(bytes);
  const Result<SceneFormat> format = detect_format(file, name);
  if (!format.ok()) {
    return in_context(name, format.status());
  }
  if (*format == SceneFormat::gltf) {
    return import_gltf_memory(bytes, name, options, ledger, sink, report);
  }
  return import_mesh(*format, file, name, options, ledger, sink, report);
}

}  // namespace raymill::storage
