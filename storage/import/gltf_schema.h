// GltfSchema: brings a parsed glTF document into the form that the rest of the import may trust.
//
// A table lists every field that Raymill reads, with its type and its range; everything else (materials, animations,
// extras, ...) is removed. After normalize() holds: every index points at an element that exists, every size and count
// is a whole number in range, numbers written as 1.0 or 1e0 are integers, arrays have the length they need. What a
// table cannot say (ranges of bytes, node cycles) is checked where it is used.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "storage/base/status.h"

namespace raymill::storage {

/// Normalises `root` in place. Errors: bad_scene, with the path of the field ("accessors[3].count is -1; ...").
Status normalize(nlohmann::json& root);

}  // namespace raymill::storage
