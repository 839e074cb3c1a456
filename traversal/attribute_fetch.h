// Attributes of hits: looked up once a ray has ended, so that no step of a traversal knows of them.
//
//   ended, hit --begin--> page of its geometry --> page of its triangle's entry --> values, done
//                             |  not there: the ray waits, as for any other page  |
//
// What a geometry's page said goes along in the ray's record, so a ray needs one page at a time. Values are computed in
// float64, in one order, and rounded once (storage/ATTRIBUTES.md); compiled once, for the architecture's least machine:
// so they do not depend on the machine, the page cut or the schedule. Callers hold an IeeeScope.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "storage/pages/attribute_page.h"
#include "traversal/query.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

/// Fields that attributes answer, and the attributes that answer fields.
storage::AttributeSet attributes_for(Field fields);
Field fields_of(storage::AttributeSet attributes);

/// What fetch_attributes() reads. Plain data; pages found through `images` must stay until the call returns.
struct AttributeContext {
  storage::AttributePlaces places;
  storage::AttributeSet asked = 0;                        ///< of the store's
  const std::atomic<const std::byte*>* images = nullptr;  ///< [page_count]; null: not resident
  std::atomic<std::uint8_t>* touched = nullptr;           ///< [page_count]; set when a page is looked at
  std::uint64_t pages_entered = 0;
  std::uint64_t entries_read = 0;
  bool corrupt = false;  ///< set when a page has not what another one says that it has
};

/// A ray that has ended with a hit asks for its attributes from now on, and is not done.
void begin_attributes(const AttributeContext& context, RayState& ray);

/// Takes the rays that ask for attributes as far as they come: values[i] is what rays[i] gets. A ray that is not done
/// afterwards waits for `ray.page`. Thread-safe; no allocation, no lock.
void fetch_attributes(AttributeContext& context, std::span<RayState> rays, std::span<HitAttributes> values);

}  // namespace raymill::traversal
