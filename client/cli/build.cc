#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/interrupt.h"
#include "client/cli/manifest.h"
#include "client/cli/options.h"
#include "client/cli/verbs.h"
#include "client/cpp/raymill.h"
#include "storage/base/atomic_file.h"

namespace raymill::client {

namespace {

struct BuildOptions {
  BuildConfig config;
  std::uint64_t page_bytes = BuildConfig().page_bytes;
  std::string manifest;
  std::string stats;
  std::string progress;
  bool json = false;
};

// Scenes that were named on the command line come first.
Status add_manifest(BuildOptions& options) {
  if (!options.manifest.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(const std::vector<std::string> listed, read_manifest(options.manifest));
    options.config.scenes.insert(options.config.scenes.end(), listed.begin(), listed.end());
  }
  if (options.config.scenes.empty()) {
    return {ErrorCode::invalid_argument, "SCENE or --manifest is required; see 'raymill build --help'"};
  }
  return {};
}

Status run(BuildOptions& options) {
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  if (options.page_bytes > UINT32_MAX) {
    return {ErrorCode::invalid_argument, "--page-size goes from 16K to 1M"};
  }
  options.config.page_bytes = static_cast<std::uint32_t>(options.page_bytes);
  RAYMILL_RETURN_IF_ERROR(add_manifest(options));
  std::optional<storage::AtomicFile> stats;  // a folder that is not there is found before the work
  if (!options.stats.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(stats, storage::AtomicFile::create(options.stats));
  }
  std::optional<Progress> progress(style);
  options.config.progress = [&](const char* phase, double fraction) {
    progress->report(phase, fraction);
    return !interrupted();
  };
  const auto report = build(options.config);
  progress.reset();
  if (!report) {
    return interrupted() ? interrupted_status() : report.status();
  }
  const nlohmann::json object = build_json(*report, options.config.output);
  if (stats) {
    RAYMILL_RETURN_IF_ERROR(write_json(*stats, object));
  }
  return options.json ? print_json(object) : print(build_text(*report, options.config.output));
}

}  // namespace

Verb add_build(CLI::App& app) {
  const auto options = std::make_shared<BuildOptions>();
  CLI::App* verb = app.add_subcommand("build", "Make a scene store from glTF, PLY, OBJ, STL and OpenVDB files");
  verb->footer(
      "\nReads glTF 2.0 (.gltf and .glb; Draco and meshopt too), PLY, OBJ, STL (in words and in binary) and OpenVDB\n"
      "(fog volumes and level sets of float32), told apart by their first bytes. Meshes that many nodes use are "
      "stored\n"
      "once (--instances), others in world space; faces of many corners are cut into triangles. Leaves that a\n"
      "material of alphaMode MASK cuts out of a texture are cut out: alpha is read by its nearest texel. The store is\n"
      "written under a temporary name and renamed when whole. The same scenes give the same bytes.\n\n"
      "  raymill build city.gltf -o city.mill --memory 1G\n"
      "  raymill build --manifest tiles.txt -o country.mill --stats build.json");
  verb->add_option("SCENE", options->config.scenes,
                   ".gltf, .glb, .ply, .obj, .stl or .vdb files; geometry ids number on from file to file")
      ->type_name("");
  verb->add_option("--manifest", options->manifest,
                   "A text file that lists more scenes, one a line, relative to its folder; empty lines and lines that "
                   "begin with # are left out")
      ->type_name("FILE");
  verb->add_option("-o,--output", options->config.output, "The store to write")->required()->type_name("X.mill");
  add_parsed(*verb, "--memory", options->config.memory, parse_bytes,
             "Limit of the whole process: bytes, or with K, M, G, T. Default 2G", "SIZE");
  verb->add_option("--positions", options->config.positions,
                   "float32 (exact), lattice:STEP (scene units, rounded down to a power of two) or lattice:BITSb")
      ->type_name("KIND")
      ->capture_default_str();
  verb->add_option("--origin", options->config.origin,
                   "What positions are kept relative to: auto (the middle of the first scene where that lies far out), "
                   "none (the world's zero) or X,Y,Z")
      ->type_name("POINT")
      ->capture_default_str();
  verb->add_option("--origins", options->config.origins,
                   "Whether parts that lie far apart are kept relative to origins of their own: auto (where float32 "
                   "would move them by a thousandth of a unit; not with --origin none), always (rays of float64 keep "
                   "all digits to every placed object too), never")
      ->type_name("RULE")
      ->capture_default_str();
  verb->add_option("--codec", options->config.codec, "raw, lz4, zstd, or draco (smallest, needs a lattice)")
      ->type_name("NAME")
      ->capture_default_str();
  verb->add_option("--width", options->config.width, "Children of a node: 4 or 8")
      ->type_name("N")
      ->check(CLI::IsMember({4, 8}))
      ->capture_default_str();
  add_parsed(*verb, "--page-size", options->page_bytes, parse_bytes, "Limit of a decoded page, 16K to 1M. Default 64K",
             "SIZE");
  verb->add_option(
          "--instances", options->config.instances,
          "Which meshes are stored once and placed: auto (where that takes at most half the bytes), always, never")
      ->type_name("RULE")
      ->capture_default_str();
  verb->add_flag("--proxies", options->config.proxies,
                 "Store what stands for distant parts of the scene, so that 'raymill trace --tolerance' need not read "
                 "them: 2 to 5 % more bytes");
  verb->add_option(
          "--volume-transform", options->config.volume_transforms,
          "Where a .vdb scene stands: 12 or 16 numbers with commas, the rows of an affine matrix, or identity. "
          "Once for each .vdb, in their order")
      ->type_name("ROWS")
      ->allow_extra_args(false);
  verb->add_option("--volume-values", options->config.volume_values,
                   "How voxels are kept: float32 (as they are) or lattice:STEP (multiples of STEP rounded down to a "
                   "power of two, in 8 or 16 bits)")
      ->type_name("KIND")
      ->capture_default_str();
  verb->add_option("--grid", options->config.volume_grids, "Take only the grids of this name; may be given again")
      ->type_name("NAME")
      ->allow_extra_args(false);
  verb->add_flag("--ignore-alpha", options->config.ignore_alpha,
                 "Take every triangle as opaque, whatever its material says; no texture is read then");
  verb->add_option("--blend-as-mask", options->config.blend_as_mask,
                   "Cut triangles of alphaMode BLEND out where their alpha is below this, as those of MASK are below "
                   "their alphaCutoff; left out: they are opaque")
      ->type_name("CUTOFF");
  verb->add_flag("--cull-back-faces", options->config.cull_back_faces,
                 "Let rays pass from the back where a material is not doubleSided; left out: both sides are hit");
  verb->add_option(
          "--attributes", options->config.attributes,
          "Keep attributes of the triangles' corners in pages of their own: some of normal, uv0, uv1, color0, "
          "with commas between them; 'raymill trace --fields shading_normal,uv0,uv1,color0' then gives them at "
          "each hit. Of glTF alone; left out: none")
      ->type_name("NAMES");
  verb->add_option("--threads", options->config.threads, "Threads; 0: one for each core")
      ->type_name("N")
      ->capture_default_str();
  verb->add_option("--scene", options->config.scene_index, "Index of the glTF scene; left out: the file's default")
      ->type_name("I");
  add_progress_option(*verb, options->progress);
  verb->add_option("--stats", options->stats, "Write what --json prints to this file, memory peaks by use included")
      ->type_name("FILE.json");
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
