#include <algorithm>
#include <array>
#include <functional>
#include <iterator>
#include <optional>
#include <utility>

#include "storage/import/extent.h"
#include "storage/import/gltf_attributes.h"
#include "storage/import/gltf_buffers.h"
#include "storage/import/gltf_container.h"
#include "storage/import/gltf_document.h"
#include "storage/import/gltf_masks.h"
#include "storage/import/gltf_nodes.h"
#include "storage/import/gltf_primitives.h"
#include "storage/import/gltf_scene.h"
#include "storage/import/message.h"
#include "storage/import/scene_import.h"
#include "storage/import/tinygltf_config.h"
#include "storage/import/triangle_filter.h"

namespace raymill::storage {

namespace {

// What is being read: the name that reports carry, the bytes, and the folder of the files beside it.
struct SceneFile {
  std::string name;
  ByteSource bytes;
  std::optional<std::string> folder;
};

void note_extensions(const std::vector<std::string>& names, ImportReport& report) {
  if (names.empty()) {
    return;
  }
  report.counts[ImportCode::extension_ignored] += names.size();
  std::vector<std::string>& all = report.ignored_extensions;
  all.insert(all.end(), names.begin(), names.end());
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
}

Status import_scene(const SceneFile& file, const ImportOptions& options, Ledger& ledger, TriangleSink& sink,
                    ImportReport& report, bool& sink_failed) {
  RAYMILL_ASSIGN_OR_RETURN(const GltfContainer container, read_container(file.bytes));
  RAYMILL_ASSIGN_OR_RETURN(
      GltfDocument document,
      GltfDocument::load(file.bytes, container, ledger, options.masks != nullptr ? options.mask_rule : MaskRule(),
                         options.attribute_sink != nullptr ? options.attributes : 0));
  RAYMILL_ASSIGN_OR_RETURN(GltfScene scene, place_nodes(document.model(), options.scene, ledger));
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation scratch,
                           ledger.claim(Tag::build, TriangleWriter::heap_bytes() + kPrimitiveScratchBytes));
  if (document.meshopt_views() != 0) {
    report.counts[ImportCode::meshopt_views] += document.meshopt_views();
  }
  GltfBuffers buffers(file.bytes, container.binary, file.folder, document.take_buffers(), ledger);
  note_extensions(document.ignored_extensions(), report);
  std::vector<CameraInfo> cameras = placed_cameras(document.model(), scene);
  std::move(cameras.begin(), cameras.end(), std::back_inserter(report.cameras));
  for (PlacedNode& placed : scene.nodes) {
    placed.world_from_node.move_back(options.origin);
  }

  TriangleWriter writer(sink, report);
  std::optional<GltfMasks> masks;
  if (options.masks != nullptr && !document.materials().materials.empty()) {
    masks.emplace(
        GltfMasks::Config{document, document.materials(), buffers, file.folder, *options.masks, ledger, report});
  }
  std::optional<GltfAttributes> attributes;
  if (options.attribute_sink != nullptr && options.attributes != 0) {
    attributes.emplace(
        GltfAttributes::Config{document, buffers, options.attributes, *options.attribute_sink, ledger, report});
  }
  Status status = import_nodes(
      {document, buffers, ledger, writer, report, masks ? &*masks : nullptr, attributes ? &*attributes : nullptr},
      scene, file.name, options);
  sink_failed = writer.sink_failed();
  return status;
}

std::array<double, 3> translation_of(const Transform& transform) {
  return {transform.m[12], transform.m[13], transform.m[14]};
}

// Where the scene's meshes are put. Nodes that hold none are taken out.
Extent places_of_meshes(const tinygltf::Model& model, GltfScene& scene) {
  std::erase_if(scene.nodes,
                [&](const PlacedNode& placed) { return model.nodes[static_cast<std::size_t>(placed.node)].mesh < 0; });
  Extent places;
  for (const PlacedNode& placed : scene.nodes) {
    places.grow(translation_of(placed.world_from_node));
  }
  return places;
}

Result<SceneLook> look_at(const SceneFile& file, std::optional<std::uint32_t> scene_index, Ledger& ledger,
                          const std::function<Status()>& keep_going, bool& stopped) {
  RAYMILL_ASSIGN_OR_RETURN(const GltfContainer container, read_container(file.bytes));
  RAYMILL_ASSIGN_OR_RETURN(GltfDocument document, GltfDocument::load(file.bytes, container, ledger));
  RAYMILL_ASSIGN_OR_RETURN(GltfScene scene, place_nodes(document.model(), scene_index, ledger));
  SceneLook look;
  Extent& extent = look.extent = places_of_meshes(document.model(), scene);
  RAYMILL_ASSIGN_OR_RETURN(look.claim, ledger.claim(Tag::build, 3 * scene.nodes.size() * sizeof(ScenePiece)));
  look.pieces.reserve(scene.nodes.size());
  for (const PlacedNode& placed : scene.nodes) {
    look.pieces.push_back(piece_of(document.model(), placed));
  }
  if (!extent.is_far()) {
    extent = {};
    return look;
  }
  RAYMILL_ASSIGN_OR_RETURN(BudgetReservation scratch,
                           ledger.claim(Tag::build, TriangleWriter::heap_bytes() + kPrimitiveScratchBytes));
  GltfBuffers buffers(file.bytes, container.binary, file.folder, document.take_buffers(), ledger);
  scene.nodes.resize(1);
  const std::array<double, 3> origin = translation_of(scene.nodes[0].world_from_node);
  scene.nodes[0].world_from_node.move_back(origin);
  ExtentSink sink(origin, keep_going);
  ImportReport unused;
  TriangleWriter writer(sink, unused);
  const Status status = import_nodes({document, buffers, ledger, writer, unused}, scene, file.name, {});
  stopped = writer.sink_failed();
  RAYMILL_RETURN_IF_ERROR(status);
  if (!sink.extent().empty()) {
    extent.join(sink.extent());
  }
  return look;
}

// Puts the file's name before an error of the import; the sink's errors pass as they are.
Status import_file(const SceneFile& file, const ImportOptions& options, Ledger& ledger, TriangleSink& sink,
                   ImportReport& report) {
  bool sink_failed = false;
  Status status = import_scene(file, options, ledger, sink, report, sink_failed);
  return status.ok() || sink_failed ? status : in_context(file.name, status);
}

Result<SceneFile> open_scene(const std::string& path) {
  SceneFile file;
  file.name = path;
  RAYMILL_ASSIGN_OR_RETURN(file.bytes, ByteSource::open(path));
  const std::size_t slash = path.find_last_of('/');
  file.folder = slash == std::string::npos ? std::string() : path.substr(0, slash + 1);
  return file;
}

}  // namespace

Status import_gltf(const std::string& path, const ImportOptions& options, Ledger& ledger, TriangleSink& sink,
                   ImportReport& report) {
  RAYMILL_ASSIGN_OR_RETURN(const SceneFile file, open_scene(path));
  return import_file(file, options, ledger, sink, report);
}

Result<SceneLook> look_at_gltf(const std::string& path, std::optional<std::uint32_t> scene, Ledger& ledger,
                               const std::function<Status()>& keep_going) {
  RAYMILL_ASSIGN_OR_RETURN(const SceneFile file, open_scene(path));
  bool stopped = false;
  Result<SceneLook> look = look_at(file, scene, ledger, keep_going, stopped);
  return look.ok() || stopped ? std::move(look) : in_context(path, look.status());
}

Status import_gltf_memory(std::span<const std::byte> bytes, const std::string& name, const ImportOptions& options,
                          Ledger& ledger, TriangleSink& sink, ImportReport& report) {
  return import_file({name, ByteSource::view(bytes), std::nullopt}, options, ledger, sink, report);
}

}  // namespace raymill::storage
