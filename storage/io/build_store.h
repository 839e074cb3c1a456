// Making stores and looking into them: what `raymill build`, `verify` and `inspect` do, as calls. Public.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"

namespace raymill {

struct BuildConfig {
  std::vector<std::string> scenes = {};  ///< glTF, GLB, PLY, OBJ, STL or VDB; geometry ids number on from file to file
  std::string output = {};               ///< NAME.mill; written to a temporary name beside it and renamed when whole
  std::uint64_t memory = gibibytes(2);   ///< limit of the whole process
  std::optional<std::uint32_t> scene_index = {};
  std::string positions = "float32";  ///< "float32", "lattice:STEP" (rounded down to a power of two) or "lattice:BITSb"
  std::string codec = "zstd";         ///< raw, lz4, zstd, draco (draco needs a lattice)
  unsigned width = 8;                 ///< children of a node: 4 or 8
  std::uint32_t page_bytes = 64 << 10;  ///< decoded size limit of a page, 16 KiB to 1 MiB
  std::string instances = "auto";  ///< which meshes are stored once and placed: "auto" (where that takes at most half
                                   ///< the bytes), "always", "never"
  bool proxies = false;  ///< store what stands for subtrees, for jobs with a tolerance (TraceConfig::tolerance)
  std::vector<std::string> volume_transforms =
      {};                                      ///< of .vdb scenes in their order, rows of a 3 x 4 matrix, "1,0,..."
  std::string volume_values = "float32";       ///< or "lattice:STEP": rounded to multiples of a power of two
  std::vector<std::string> volume_grids = {};  ///< names of the grids to take; none: all
  bool ignore_alpha = false;                   ///< no triangle is cut out by a mask, whatever its material says
  std::optional<double> blend_as_mask = {};    ///< materials of mode BLEND are masks with this cutoff; none: opaque
  bool cull_back_faces = false;                ///< rays pass a triangle from its back where its material has one side
  /// Attributes of triangles' corners to keep, for the fields shading_normal, uv0, uv1 and color0: some of "normal",
  /// "uv0", "uv1", "color0" with commas between them; "": none. glTF alone has them. A StoreWriter takes none.
  std::string attributes = {};
  /// What positions are kept relative to: "auto" (a point of the first scene where that lies far out, else the world's
  /// zero), "none" (the world's zero) or "X,Y,Z". A StoreWriter takes "auto" for "none".
  std::string origin = "auto";
  /// Whether parts of the scene that lie apart, further out than float32 can tell a thousandth of a unit, are kept
  /// relative to origins of their own: "auto" (unless `origin` is "none"), "never", or "always": as auto, and rays of
  /// float64 keep all their digits on the way to every placed object (TraceConfig::float64).
  std::string origins = "auto";
  unsigned threads = 0;  ///< 0: one for each core; the bytes of the store do not depend on it
  /// Called now and then, from one thread at a time, with a phase ("import", "partition", "masks", "build",
  /// "attributes", "volumes")
  /// and a fraction in [0,1]; returns false to stop the build (interrupted).
  std::function<bool(const char* phase, double fraction)> progress = {};
};

/// Figures of a build, and its import report as JSON ({"counts":{"dropped_degenerate":{"code":100,"count":3}},...}).
struct BuildReport {
  std::uint64_t triangles = 0;  ///< stored; those of an object once
  std::uint64_t instances = 0;
  std::uint64_t objects = 0;  ///< that are placed
  std::uint64_t nodes = 0;
  std::uint64_t pages = 0;
  std::uint64_t store_bytes = 0;
  std::uint64_t decoded_bytes = 0;
  std::uint32_t levels = 0;
  std::uint64_t volumes = 0;
  std::uint64_t bricks = 0;              ///< of all volumes
  std::uint64_t masks = 0;               ///< textures that triangles are cut out by
  std::uint64_t mask_pages = 0;          ///< of their texels
  std::uint64_t mask_bytes = 0;          ///< of those in the store
  std::uint64_t mask_section_bytes = 0;  ///< that pages of triangles hold for masks, decoded
  std::uint64_t attribute_entries = 0;   ///< triangles whose attributes are kept; those of a mesh once
  std::uint64_t attribute_pages = 0;
  std::uint64_t attribute_bytes = 0;  ///< of those in the store
  std::uint64_t attribute_decoded_bytes = 0;
  std::array<double, 3> origin{};     ///< what positions are relative to, in the world
  std::uint64_t parts = 0;            ///< of the scene that have origins of their own; they count as objects too
  double sah_cost = 0;                ///< surface-area cost, node step 1, triangle test 1, relative to the root's area
  double max_displacement = 0;        ///< of a vertex by the lattice, scene units; 0 for float32
  double rms_displacement = 0;        ///< the same, root of the mean square over the corners of all triangles
  std::uint64_t runs = 0;             ///< parts of the scene that were built one by one
  unsigned runs_at_once = 0;          ///< as memory and threads allowed
  std::uint64_t temporary_bytes = 0;  ///< of the nameless temporary file at its largest; 0: none was needed
  std::string temporary_folder;       ///< where it stood
  double import_seconds = 0;
  double partition_seconds = 0;
  double build_seconds = 0;
  std::uint64_t peak_rss_bytes = 0;
  std::map<std::string, std::uint64_t> peak_bytes_by_tag;  ///< most that was claimed for each use of memory
  std::string import_json;
};

/// Errors: not_found, io, disk_full, bad_scene, unsupported, invalid_argument, budget_exceeded, interrupted.
/// On any error nothing is left at `output` that was not there before. Scenes larger than `memory` go through a
/// temporary file beside the output (in TMPDIR where the output is a device or a pipe), about 44 bytes a triangle; it
/// has no name and ends with the process.
Result<BuildReport> build(const BuildConfig& config);

/// Triangles in the caller's memory; read during the call only.
struct MeshView {
  std::string_view name = {};                   ///< what `info` calls the geometry
  std::span<const float> positions = {};        ///< [3 * vertex_count] x, y, z
  std::span<const double> positions64 = {};     ///< the same in float64, in place of `positions`; rounded once
  std::span<const std::uint32_t> indices = {};  ///< [3 * triangle_count]; empty: each three vertices are a triangle
  /// Column-major; applied in float64 and rounded once. Left out: positions are in world space, and those of float32
  /// are kept bit for bit where the store has no origin.
  std::optional<std::array<double, 16>> world_from_mesh = {};
};

/// Streams meshes from any pipeline into a store, under the same memory limit and with the same result as build().
///
///   auto writer = StoreWriter::create({.output = "x.mill", .memory = gibibytes(1)});
///   writer->add({.name = "hull", .positions = xyz, .indices = corners});   // geometry 0, then 1, 2, ...
///   auto tree = writer->add_object(meshes);                                // stored once ...
///   writer->place(*tree, world_from_tree);                                 // ... and placed any number of times
///   auto report = writer->finish();
///
/// Destruction without finish() leaves nothing behind. Thread-compatible.
class StoreWriter {
 public:
  /// `config.scenes` must be empty. Errors: invalid_argument, budget_exceeded, not_found, disk_full, io.
  static Result<StoreWriter> create(const BuildConfig& config);
  StoreWriter(StoreWriter&&) noexcept;
  StoreWriter& operator=(StoreWriter&&) noexcept;
  ~StoreWriter();

  /// Adds a geometry: the next geometry_id; primitive_id counts its triangles, dropped ones included.
  /// Errors: invalid_argument (nothing was added), disk_full, io, interrupted (the writer is done for).
  Status add(const MeshView& mesh);
  /// Adds meshes as one object, in its own space: stored once, and nowhere in the scene until it is placed. The meshes'
  /// matrices place them in the object. Gives the object's number. Errors: as add().
  Result<std::uint32_t> add_object(std::span<const MeshView> meshes);
  /// Places an object: the next instance_id; its meshes get the next geometry ids. `world_from_object` is column-major.
  /// Errors: invalid_argument (no such object; a matrix that is not affine or all but singular: add() takes the mesh
  /// with it), disk_full, io.
  Status place(std::uint32_t object, const std::array<double, 16>& world_from_object);
  /// Builds the store and gives it its name. Errors: those of build(). Call once.
  Result<BuildReport> finish();

 private:
  class Impl;
  explicit StoreWriter(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

struct VerifyReport {
  std::uint64_t pages = 0;
  std::uint64_t bytes = 0;
  std::uint64_t triangles = 0;
  std::uint64_t instances = 0;
  std::uint64_t volumes = 0;
  std::uint64_t bricks = 0;
};
/// Reads a whole store and checks every checksum, every structure rule and that every box holds its triangles.
Result<VerifyReport> verify(const std::string& path);

/// A page's contents as JSON, decoded as far as the bytes allow; never writes.
Result<std::string> inspect_page(const std::string& path, std::uint32_t page);

}  // namespace raymill
