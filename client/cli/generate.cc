#include "client/cli/generate/generate.h"

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/interrupt.h"
#include "client/cli/options.h"
#include "client/cli/verbs.h"

namespace raymill::client {

namespace {

struct GenerateOptions {
  SceneKind kind = SceneKind::terrain;
  std::uint64_t triangles = 0;
  std::uint64_t seed = 1;
  unsigned meshes = 200;
  std::string output;
  std::string progress;
  bool json = false;
};

Status run(const GenerateOptions& options) {
  if (options.triangles == 0) {
    return {ErrorCode::invalid_argument, "--triangles must be at least 1"};
  }
  RAYMILL_ASSIGN_OR_RETURN(const ProgressStyle style, parse_progress_style(options.progress));
  std::optional<Progress> progress(style);
  RAYMILL_ASSIGN_OR_RETURN(SceneWriter scene, SceneWriter::create(options.output, [&](std::uint64_t triangles) {
                             progress->report("generate",
                                              static_cast<double>(triangles) / static_cast<double>(options.triangles),
                                              triangles, "triangles");
                             return !interrupted();
                           }));
  Status status = generate(options.kind, options.triangles, options.seed, options.meshes, scene);
  if (status.ok()) {
    status = scene.finish();
  }
  progress.reset();
  if (!status.ok()) {
    return interrupted() ? interrupted_status() : status;
  }
  if (options.json) {
    return print_json({{"output", options.output},
                       {"triangles", scene.triangles()},
                       {"bytes", scene.bytes()},
                       {"buffers", scene.files()}});
  }
  return print(options.output + ": " + std::to_string(scene.triangles()) + " triangles, " +
               std::to_string(scene.files()) + " buffers, " + storage::format_bytes(scene.bytes()) + "\n");
}

}  // namespace

Verb add_generate(CLI::App& app) {
  const auto options = std::make_shared<GenerateOptions>();
  CLI::App* verb = app.add_subcommand("generate", "Make up a scene of any size");
  verb->footer(
      "\nKinds: terrain (a fractal heightfield), city (buildings with window frames), forest (trees and grass of thin\n"
      "triangles), mixed (a city and a forest between mountains), woods (kinds of tree, each stored once and placed\n"
      "often). Lengths are metres, y is up, and cameras are in the scene. The same kind, count and seed give the same "
      "triangles. S.gltf comes with buffers S-00000.bin and so on,\n"
      "which replace those of an earlier run; memory does not grow with the scene.\n\n"
      "  raymill generate city --triangles 20M -o city.gltf");
  add_parsed(*verb, "KIND", options->kind, parse_scene_kind, "terrain, city, forest, mixed or woods", "")->required();
  add_parsed(*verb, "--triangles", options->triangles, parse_count,
             "How many; k, M and G are powers of 1000. Met exactly, by woods as near as whole trees come", "N")
      ->required();
  verb->add_option("-o,--output", options->output, "The scene to write")->required()->type_name("S.gltf");
  verb->add_option("--seed", options->seed, "Another seed, another scene")->type_name("N")->capture_default_str();
  verb->add_option("--meshes", options->meshes, "Kinds of tree in woods")
      ->type_name("N")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  add_progress_option(*verb, options->progress);
  add_json_flag(*verb, options->json);
  return {verb, [options] { return run(*options); }};
}

}  // namespace raymill::client
