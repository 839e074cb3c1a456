// GltfExtensions: which extensions Raymill models, which only shade, and which stop the import.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill::storage {

struct ExtensionUse {
  bool quantization = false;         ///< KHR_mesh_quantization
  std::vector<std::string> ignored;  ///< in use and not modelled: sorted, each once
};

/// Looks at extensionsUsed and extensionsRequired of a normalised document. A required extension passes when it is
/// modelled, or when it is known to change shading only. Errors: unsupported, by the extension's name.
Result<ExtensionUse> check_extensions(const nlohmann::json& root);

}  // namespace raymill::storage
