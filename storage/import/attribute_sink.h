// AttributeSink: what takes the attributes of a scene's triangles. Called from the thread that calls the TriangleSink.
#pragma once

#include <cstdint>
#include <span>

#include "storage/base/attribute.h"
#include "storage/base/status.h"

namespace raymill::storage {

class AttributeSink {
 public:
  virtual ~AttributeSink() = default;
  /// Keeps entries: of each triangle the attributes of its three corners, 3 * corner_floats() numbers; those of one
  /// mesh come one after the other. Gives the number of the first of them. Errors: disk_full, io.
  virtual Result<std::uint64_t> add_entries(std::span<const float> entries) = 0;
  /// Says where a geometry's entries are. Ids rise from call to call; those that are left out have none.
  /// Errors: disk_full, io.
  virtual Status set_attributes(std::uint32_t geometry_id, const AttributeGeometry& geometry) = 0;
};

}  // namespace raymill::storage
