#include "tests/support/embree_files.h"

#include <limits>

namespace raymill::bench {

Result<EmbreeScene> embree_of_files(const std::vector<std::string>& scenes, const EmbreeScene::Config& config) {
  return EmbreeScene::create(config, [&](storage::TriangleSink& sink) -> Status {
    storage::Ledger ledger(std::numeric_limits<std::uint64_t>::max());
    storage::ImportReport report;
    for (const std::string& scene : scenes) {
      RAYMILL_RETURN_IF_ERROR(storage::import_scene(scene, {}, ledger, sink, report));
    }
    return {};
  });
}

}  // namespace raymill::bench
