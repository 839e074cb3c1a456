// Which scenes lie so far out that float32 in world space would lose them, and where their own zero is then put.
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "storage/base/ledger.h"
#include "storage/base/origin.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

/// A scene lies far out where its middle is further from zero than this many times its largest side: a step of float32
/// there is more than 2^-18 of its size.
constexpr double kFarSides = 64;

/// "auto" (nothing: the first scene decides), "none" (zero) or "X,Y,Z". Errors: invalid_argument.
Result<std::optional<Origin>> parse_origin(const std::string& text);

/// The origin that suits a scene file: zero where world space does, or where the file's own float32 has lost what
/// there was to lose (a glTF whose nodes move nothing, a binary STL, a PLY of float32); else near the middle of what
/// was looked at. That is of a glTF where its nodes stand, and the first mesh if these are far out; of an OBJ, an STL
/// in words and a PLY all of it, read once more, where it begins beyond 2^14 or holds float64. `keep_going` is asked
/// now and then. Errors: those of import_scene(), and keep_going's, word for word.
Result<Origin> choose_origin(const std::string& path, const ImportOptions& options, Ledger& ledger,
                             const std::function<Status()>& keep_going);

}  // namespace raymill::storage
