// GltfAttributeSources: which accessors hold the attributes that are asked for, read from the JSON before it is
// normalised (gltf_schema.h), and only where some are. Immutable.
#pragma once

#include <array>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "storage/base/attribute.h"
#include "storage/base/ledger.h"
#include "storage/base/status.h"

namespace raymill::storage {

/// Of one attribute of a primitive.
struct AttributeSource {
  static constexpr int kNone = -1, kBroken = -2;
  int accessor = kNone;  ///< kBroken: what is named is no accessor of the file
  int draco = kNone;     ///< attribute of the primitive's Draco stream
};
using PrimitiveAttributes = std::array<AttributeSource, kAttributeCount>;

struct GltfAttributeSources {
  BudgetReservation claim;
  std::vector<std::vector<PrimitiveAttributes>> primitives;  ///< [mesh][primitive]

  /// Null: nothing is known of it.
  [[nodiscard]] const PrimitiveAttributes* find(int mesh, std::size_t primitive) const;
};

/// Errors: budget_exceeded.
Result<GltfAttributeSources> read_attribute_sources(const nlohmann::json& root, AttributeSet asked, Ledger& ledger);

}  // namespace raymill::storage
