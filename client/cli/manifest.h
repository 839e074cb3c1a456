// Manifests: text files that list the scene files of a build. Pure function of the file system.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill::client {

/// Limits, so that a file that is no manifest takes no memory.
constexpr std::size_t kMostManifestLineBytes = 4096;  // PATH_MAX
constexpr std::size_t kMostManifestScenes = 1 << 20;

/// The scenes that `path` lists, one a line, in its order: empty lines and lines that begin with # left out, relative
/// names relative to the manifest's folder. Each is looked for, so that one that is missing is found at once.
/// Errors: not_found (the manifest, or a scene, by line), bad_scene (it lists nothing, or is no list), io.
Result<std::vector<std::string>> read_manifest(const std::string& path);

}  // namespace raymill::client
