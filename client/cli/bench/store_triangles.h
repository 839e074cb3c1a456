// The triangles of a store, for a peer that is to see the same ones.
#pragma once

#include <string>

#include "storage/base/status.h"
#include "storage/import/scene_import.h"

namespace raymill::client {

/// Hands every triangle of the store at `path` to `sink`, page by page, as the kernels see it: after codec and lattice.
/// Errors: those of opening and reading a store, and the sink's.
Status read_store_triangles(const std::string& path, storage::TriangleSink& sink);

}  // namespace raymill::client
