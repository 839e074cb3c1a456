// Store names: what a client may ask for, and the file it means.
//
// A name is a path below the stores directory, with or without ".mill": "city", "maps/city.mill". It never leaves the
// directory: no absolute path, no "." or ".." part, and no link that leads out of it. Thread-safe functions.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "storage/base/status.h"

namespace raymill::server {

/// The one spelling of a store's name, without ".mill". Looks at nothing on disk.
/// Errors: invalid_argument.
Result<std::string> canonical_store_name(std::string_view name);

/// The file that a canonical name stands for.
/// Errors: not_found (no such file), invalid_argument (a link that leads out of the directory, or no regular file).
Result<std::string> store_path(const std::string& stores_directory, const std::string& canonical_name);

struct StoreNames {
  std::vector<std::string> names;  ///< canonical, sorted
  bool truncated = false;
};
/// The stores below the directory, kMostListedStores at most and eight folders deep.
StoreNames list_stores(const std::string& stores_directory);

}  // namespace raymill::server
