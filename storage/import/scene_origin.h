// Which scenes lie so far out that float32 in world space would lose them, and where their own zero is then put.
#pragma once

#include <array>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/origin.h"
#include "storage/base/status.h"
#include "storage/import/scene_import.h"
#include "storage/import/scene_parts.h"

namespace raymill::storage {

/// "auto" (nothing: the first scene decides), "none" (zero) or "X,Y,Z". Errors: invalid_argument.
Result<std::optional<Origin>> parse_origin(const std::string& text);

/// What is seen of a scene file before it is imported, in world space.
struct SceneLook {
  Extent extent;                   ///< of a file whose numbers hold more than float32 where it stands, else empty
  std::vector<ScenePiece> pieces;  ///< of a glTF; of other files the whole, where it was looked at
  bool is_whole = false;           ///< the file is one piece
  BudgetReservation claim;         ///< of the pieces, a copy and room to grow included
};

/// Looks at a glTF where its nodes stand, and at the first mesh if these are far out; at all of an OBJ, an STL in words
/// and a PLY, which is then read once more, where it begins further than 2^14 from `near` (where not given: from zero,
/// and a PLY wherever it begins). `keep_going` is asked now and then. Errors: those of import_scene(), and
/// keep_going's, word for word.
Result<SceneLook> look_at_scene(const std::string& path, const ImportOptions& options,
                                const std::optional<std::array<double, 3>>& near, Ledger& ledger,
                                const std::function<Status()>& keep_going);

/// The origin that suits what was looked at first: zero where world space does, or where the file's own float32 has
/// lost what there was to lose (a glTF whose nodes move nothing, a binary STL, a PLY of float32); else near the middle.
Origin choose_origin(const Extent& extent);
/// The same of a file. Errors: those of look_at_scene().
Result<Origin> choose_origin(const std::string& path, const ImportOptions& options, Ledger& ledger,
                             const std::function<Status()>& keep_going);

}  // namespace raymill::storage
