// raymill-one-run: the tree that a build would make if it cut nothing: all triangles of the scenes are one run.
//
//   raymill-one-run SCENE... [--memory SIZE]
//
// Prints a line of JSON: triangles, sah_cost, levels, nodes. The store itself goes nowhere. Exit codes: 0; 2 it could
// not be built.
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>

#include "client/cli/parse.h"
#include "storage/import/scene_import.h"
#include "storage/io/store_builder.h"
#include "tests/support/tool.h"

namespace raymill::bench {
namespace {

Result<BuildReport> build_one_run(const BuildConfig& config) {
  constexpr std::uint64_t kNoCut = std::numeric_limits<std::uint32_t>::max();
  RAYMILL_ASSIGN_OR_RETURN(const auto builder, storage::StoreBuilder::create(config, kNoCut));
  for (const std::string& scene : config.scenes) {
    RAYMILL_RETURN_IF_ERROR(storage::import_scene(scene, {}, builder->ledger(), *builder, builder->import_report()));
  }
  return builder->finish();
}

int run(int argc, char** argv) {
  BuildConfig config;
  config.output = "/dev/null";
  std::string memory = "64G";
  tests::Tool tool("raymill-one-run", "The tree that a build would make if it cut nothing.");
  tool.option("SCENE", config.scenes, "Scene files").required();
  tool.option("--memory", memory, "Limit of the whole process (64G)").type("SIZE");
  return tool.run(argc, argv, [&]() -> Result<bool> {
    RAYMILL_ASSIGN_OR_RETURN(config.memory, client::parse_bytes(memory));
    RAYMILL_ASSIGN_OR_RETURN(const BuildReport report, build_one_run(config));
    const nlohmann::json told = {{"triangles", report.triangles},
                                 {"runs", report.runs},
                                 {"sah_cost", report.sah_cost},
                                 {"levels", report.levels},
                                 {"nodes", report.nodes}};
    std::printf("%s\n", told.dump().c_str());
    return true;
  });
}

}  // namespace
}  // namespace raymill::bench

int main(int argc, char** argv) { return raymill::bench::run(argc, argv); }
