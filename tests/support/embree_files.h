// Scene files in Embree, for the benchmarks.
#pragma once

#include <string>
#include <vector>

#include "client/cli/bench/embree_scene.h"

namespace raymill::bench {

using client::EmbreeScene;

/// The files' triangles as they are imported, one file after the other.
Result<EmbreeScene> embree_of_files(const std::vector<std::string>& scenes, const EmbreeScene::Config& config);

}  // namespace raymill::bench
