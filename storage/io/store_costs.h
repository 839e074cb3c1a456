// What each feature of a store costs. Public.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill {

/// What a feature adds to a store. A feature whose data stand in pages of others has no bytes of its own in the file:
/// pages are compressed whole.
struct FeatureCost {
  std::string feature;                       ///< as in StoreInfo::features; "file": header, directory, metadata
  std::uint64_t pages = 0;                   ///< of its own
  std::optional<std::uint64_t> store_bytes;  ///< in the file; none: inside the triangles' pages
  std::uint64_t decoded_bytes = 0;           ///< of images in memory
};

/// The features that the store has, in the order of their bits, then "file". Reads the head of each page: bytes of
/// memory do not grow with the store, time does. Errors: those of opening a store; corrupt (a head that fits no page).
Result<std::vector<FeatureCost>> store_costs(const std::string& path);

}  // namespace raymill
