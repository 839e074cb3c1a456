// The table of volumes of an open store. Stateless.
#pragma once

#include <vector>

#include "storage/base/status.h"
#include "storage/io/store_file.h"
#include "storage/volume/volume_page.h"

namespace raymill::storage {

/// Reads the page that the footer names; none where the store has no volumes. Blocks. Errors: io, checksum_mismatch,
/// corrupt.
Result<std::vector<Volume>> read_volumes(const StoreFile& store);

}  // namespace raymill::storage
