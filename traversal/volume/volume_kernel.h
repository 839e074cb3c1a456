// The volume kernel: takes rays through resident bricks until they are done or stand before a page that is not there.
//
//   begin --> root --> node --> brick --> its node, or the root --> ... --> the volume's end --> next volume --> done
//               \________\________\___ absent: the ray waits at that page
//
// A ray waits as the record that every ray is (ray_state.h): the page is the queue's, `node` and `level` name the item
// of the page at which it goes on, and in the place of the bitstack stand how far it came (t) and what it has so far:
// 16 bytes. It needs one page at a time: from a brick whose node is gone it goes on from the root, and every step leads
// on along the ray or down the tree. A brick is passed in one go, so no answer depends on where a ray waited.
//
// Volumes come one after the other: fog for transmittance and spans, level sets for closest and any hit, after the
// triangles.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "storage/volume/volume_page.h"
#include "traversal/kernel.h"
#include "traversal/query.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

/// Set in RayState::level of a ray that is among volumes.
constexpr std::uint8_t kAmongVolumes = 0x20;  // above the levels of any tree, below the record's own flags
inline bool is_among_volumes(const RayState& ray) { return (ray.level & kAmongVolumes) != 0; }

/// What the kernel reads. Plain data.
struct VolumeContext {
  std::span<const storage::Volume> volumes = {};
  Query query = Query::closest;
  VolumeConfig config = {};
  bool need_normal = false;
  const HitFilter* filter = nullptr;    ///< none: all volumes count
  CrossingBuffer* crossings = nullptr;  ///< where spans go
  const std::atomic<const std::byte*>* images = nullptr;
  std::atomic<std::uint8_t>* touched = nullptr;
  bool lone_items = false;  ///< for tests: every ray waits at every item
  KernelCounters counters = {};
  bool corrupt = false;
};

/// Whether the query looks at any of the volumes.
bool looks_at(Query query, std::span<const storage::Volume> volumes);
/// Sets a ray off to the first volume that its query looks at; there must be one.
void begin_volumes(Query query, const VolumeConfig& config, std::span<const storage::Volume> volumes, RayState& ray);

/// Runs the rays that are among volumes and not done. Thread-safe; no allocation, no lock, no virtual call.
void run_volumes(VolumeContext& context, std::span<RayState> rays);

}  // namespace raymill::traversal
