// Import: a scene file becomes a stream of world-space triangles and a report of what was met and what was dropped.
//
// Nothing of the file is trusted: every index, offset, count and stride is checked against what it points into before
// it is used, and a file that breaks a rule is refused with one sentence that names the file and the object in it.
// Thread-compatible: one import per call, no shared state.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/placement.h"
#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/base/volume.h"
#include "storage/import/attribute_sink.h"
#include "storage/import/mask_sink.h"
#include "storage/import/scene_parts.h"

namespace raymill::storage {

/// Stable codes of the import report; never renumbered. 1xx: dropped triangles; 2xx: met and left out or taken at
/// rest; 3xx: met and handled.
enum class ImportCode : std::uint16_t {
  dropped_degenerate = 100,     ///< two corners at the same position, or zero area in exact arithmetic
  dropped_not_finite = 101,     ///< a corner is NaN or infinite
  dropped_out_of_range = 102,   ///< a coordinate beyond kPositionLimit
  dropped_cut_out = 103,        ///< a mask leaves nothing of it
  left_out_points = 200,        ///< primitives of mode POINTS
  left_out_lines = 201,         ///< primitives of mode LINES, LINE_LOOP, LINE_STRIP
  left_out_no_positions = 202,  ///< primitives without POSITION
  skin_at_rest = 203,           ///< nodes with a skin: the rest pose is taken
  morph_at_rest = 204,          ///< primitives with morph targets: weights are not applied
  extension_ignored = 205,      ///< optional extensions that change nothing Raymill models
  leftover_vertices = 206,      ///< vertices or indices past the last whole triangle
  left_out_small_faces = 207,   ///< faces of fewer than three corners
  left_out_curves = 208,        ///< free-form curves and surfaces of an OBJ
  left_out_grids = 209,         ///< grids of an OpenVDB file that cannot be traced
  draco_primitives = 300,
  sparse_accessors = 301,
  quantized_positions = 302,
  polygons = 303,                  ///< faces of more than three corners: cut into triangles
  gpu_instances = 305,             ///< placements by EXT_mesh_gpu_instancing
  meshopt_views = 304,             ///< bufferViews that EXT_meshopt_compression compresses
  masked_triangles = 306,          ///< with a mask that cuts something out of them
  opaque_under_masks = 307,        ///< of a material with a mask that cuts nothing out of them
  opaque_without_texcoords = 308,  ///< of such a material, with texture coordinates that are not finite or too large
  attributes_missing = 309,        ///< primitives of meshes that lack an attribute which is asked for
  attributes_not_finite = 310,     ///< vertices with an attribute that is NaN or infinite, kept as it is
};
std::string_view to_string(ImportCode code);

/// Largest magnitude of a coordinate that is kept: boxes and their differences stay finite in float32 below it.
constexpr float kPositionLimit = 0x1p+120F;
bool in_range(const Aabb& box);

/// One geometry_id: a (node, primitive) pair in file order, or what other formats have for it, whether or not any
/// triangle of it was kept.
struct GeometryInfo {
  std::string file;
  std::string node;  ///< the node's name, or "node<index>" where it has none; mesh alike
  std::string mesh;
  std::uint32_t primitive = 0;  ///< index in the mesh
  std::uint64_t triangles = 0;  ///< in the input, before anything was dropped
  std::uint64_t kept = 0;       ///< handed on
  std::uint32_t geometry_id = 0;
  /// Placed so often by one node (EXT_mesh_gpu_instancing), with the ids geometry_id, geometry_id + stride, ...
  std::uint32_t copies = 1, stride = 1;
};

/// A camera of the scene in world space, for render.
struct CameraInfo {
  std::string name;
  bool perspective = true;
  double yfov_radians = 0;            ///< perspective
  double aspect_ratio = 0;            ///< 0 where the file leaves it open
  double ymag = 0;                    ///< orthographic half height
  double world_from_camera[16] = {};  ///< column-major; the camera looks along -z
};

/// A grid of an OpenVDB file.
struct VolumeInfo {
  std::uint32_t geometry_id = 0;
  std::string file;
  std::string grid;
  std::string kind;
  std::uint64_t active_voxels = 0;
  Index3 origin{};  ///< of its cells, in its index space
  Index3 cells{};
};

/// What masks take in a store.
struct MaskBytes {
  std::uint64_t masks = 0;
  std::uint64_t pages = 0;          ///< of texels
  std::uint64_t encoded_bytes = 0;  ///< of those, in the store
  std::uint64_t section_bytes = 0;  ///< of what pages of triangles hold for them, decoded
};

/// What attributes take in a store.
struct AttributeBytes {
  AttributeSet set = 0;
  std::uint64_t entries = 0;  ///< triangles that have some; those of a mesh once
  std::uint64_t pages = 0;
  std::uint64_t encoded_bytes = 0;  ///< of those, in the store
  std::uint64_t decoded_bytes = 0;
};

struct ImportReport {
  std::map<ImportCode, std::uint64_t> counts;
  std::vector<GeometryInfo> geometries;  ///< rising by id
  std::uint64_t geometry_count = 0;      ///< every id is below it
  std::vector<CameraInfo> cameras;
  std::vector<VolumeInfo> volumes;
  MaskBytes masks;
  AttributeBytes attributes;
  std::vector<std::string> ignored_extensions;  ///< sorted, each once
  std::uint64_t instances = 0;                  ///< placements of objects; the next one's id
  std::uint64_t triangles = 0;                  ///< in the input, of every placement
  std::uint64_t kept = 0;

  /// A geometry with the next id.
  GeometryInfo& add_geometry() {
    GeometryInfo& geometry = geometries.emplace_back();
    geometry.geometry_id = static_cast<std::uint32_t>(geometry_count++);
    return geometry;
  }
};

/// {"counts":{"dropped_degenerate":{"code":100,"count":3},...},"ignored_extensions":[...],"triangles":N,"kept":N}
std::string to_json(const ImportReport& report);

/// Which meshes become objects that are placed, and not triangles in world space.
/// automatic: those that take at most half the bytes so. always: all whose placement can be inverted. never: none.
enum class InstanceRule : std::uint8_t { automatic, always, never };

/// Takes meshes once and how they are placed. Called from the thread that calls the TriangleSink.
class InstanceSink {
 public:
  struct Object {
    std::uint32_t number = 0;
    Aabb box;  ///< empty: nothing of it was kept
  };
  struct Placed {
    Placement world_from_object{};  ///< invertible()
    std::uint32_t object = 0;
    std::uint32_t geometry_base = 0;  ///< added to the object's own geometry ids, which begin with 0
    std::uint32_t instance_id = 0;
  };

  virtual ~InstanceSink() = default;
  /// Triangles that the TriangleSink takes from here to end_object() are the object's, in its own space.
  virtual Status begin_object() = 0;
  virtual Result<Object> end_object() = 0;
  virtual Status place(const Placed& placed) = 0;
};

/// What is made of materials' alpha and sides.
struct MaskRule {
  bool masks = false;                       ///< materials of mode MASK cut triangles out
  std::optional<double> blend_cutoff = {};  ///< those of mode BLEND too, with this cutoff; none: they are opaque
  bool one_side = false;                    ///< materials that are not doubleSided are hit from the front alone
};

struct ImportOptions {
  std::optional<std::uint32_t> scene;  ///< glTF scene index; the file's default (else the first) where not given
  InstanceRule rule = InstanceRule::automatic;
  InstanceSink* instances = nullptr;  ///< none: everything becomes triangles in world space
  /// Subtracted in float64 from every position before it is rounded, and from where objects are placed. Cameras stay.
  std::array<double, 3> origin{};
  /// Of the scene, relative to that origin. Meshes in them that become triangles come in their spaces, which
  /// `part_sink` is told before. None: all is in the scene's own space.
  std::span<const ScenePart> parts = {};
  PartSink* part_sink = nullptr;
  MaskRule mask_rule = {};
  MaskSink* masks = nullptr;    ///< none: everything is opaque, whatever the rule
  AttributeSet attributes = 0;  ///< of triangles' corners, to be kept; glTF alone has them
  AttributeSink* attribute_sink = nullptr;
};

/// Takes triangles as they come, and none now and then while much is read that gives none, so that a long import can be
/// stopped. Called from one thread; an error ends the import with that error.
class TriangleSink {
 public:
  virtual ~TriangleSink() = default;
  virtual Status add(std::span<const Triangle> triangles) = 0;
};

/// Reads a scene file of any format that detect_format() tells: import_gltf() for glTF; PLY, OBJ and STL as
/// mesh_import.h says, positions in world space as they stand, rounded once to float32 where they are wider. Memory is
/// claimed from `ledger` (Tag::build). Errors: as import_gltf().
Status import_scene(const std::string& path, const ImportOptions& options, Ledger& ledger, TriangleSink& sink,
                    ImportReport& report);

/// The same for a file that is already in memory, under `name`. Buffers beside it are not read (unsupported).
Status import_scene_memory(std::span<const std::byte> bytes, const std::string& name, const ImportOptions& options,
                           Ledger& ledger, TriangleSink& sink, ImportReport& report);

/// Reads a .gltf or .glb file and hands its triangles to `sink`, one (node, primitive) pair after the other in file
/// order; `report` is added to, so several files number their geometries on. World positions are computed in float64
/// from the nodes' matrices and rounded once to float32. Memory for the file's buffers and for one decoded mesh is
/// claimed from `ledger` (Tag::build).
/// Errors: invalid_argument (no such scene), not_found, io, bad_scene, unsupported (a required extension, by name),
/// budget_exceeded, and the sink's, word for word. After an error `report` holds what was met until then. A scene
/// without any triangle is no error here.
Status import_gltf(const std::string& path, const ImportOptions& options, Ledger& ledger, TriangleSink& sink,
                   ImportReport& report);

/// The same for a file that is already in memory, under `name`. Buffers beside it are not read (unsupported).
Status import_gltf_memory(std::span<const std::byte> bytes, const std::string& name, const ImportOptions& options,
                          Ledger& ledger, TriangleSink& sink, ImportReport& report);

}  // namespace raymill::storage
