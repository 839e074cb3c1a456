// Kernel: runs a batch of rays through the resident pages until each is done or stands before a page that is not there.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "traversal/expanded_tree.h"
#include "traversal/query.h"
#include "traversal/ray_state.h"

namespace raymill::traversal {

struct KernelCounters {
  std::uint64_t nodes_visited = 0;
  std::uint64_t triangles_tested = 0;
  std::uint64_t pages_entered = 0;
  std::uint64_t proxies_taken = 0;  ///< subtrees that were not entered, hit or passed
  std::uint64_t masks_tested = 0;   ///< hits on triangles that may be cut out
  std::uint64_t texels_read = 0;    ///< for those of them that were not known without
};

/// A hit of a ray that is asked for all of them.
struct Crossing {
  std::uint32_t number;  ///< of the ray
  Hit hit;
};

/// Where a kernel for all hits puts them. Plain data.
struct CrossingBuffer {
  std::span<Crossing> room;
  std::size_t count = 0;
  void (*take)(void* owner, std::span<const Crossing> crossings) = nullptr;  ///< called when there is no room
  void* owner = nullptr;

  void add(const Crossing& crossing) {
    if (count == room.size()) {
      empty();
    }
    room[count++] = crossing;
  }
  void empty() {
    take(owner, room.first(count));
    count = 0;
  }
};

/// Which hits count, where not all do.
struct HitFilter {
  bool skips = false;                             ///< rays have a primitive each that is no hit
  std::uint32_t mask = kAllMask;                  ///< besides a ray's own
  std::span<const std::uint32_t> geometry_masks;  ///< [geometry_id]; beyond it: all bits

  /// A hit on `ids` of a ray with these.
  [[nodiscard]] bool drops(const PrimitiveIds& skipped, std::uint32_t ray_mask, const PrimitiveIds& ids) const {
    if (skips && ids == skipped) {
      return true;
    }
    return ids.geometry_id < geometry_masks.size() && (geometry_masks[ids.geometry_id] & ray_mask & mask) == 0;
  }
};

/// How far from a surface an answer may be, for subtrees with proxies; the larger of the two counts.
struct Footprint {
  double length = 0;  ///< scene units
  double angle = 0;   ///< times t and the length of dir: of a cone
};

/// What a kernel reads. Plain data; the pages found through `images` must stay until the call returns.
struct KernelContext {
  const std::atomic<const std::byte*>* images = nullptr;  ///< [page_count]; null: not resident
  std::atomic<std::uint8_t>* touched = nullptr;           ///< [page_count]; set when a ray enters a page
  bool need_normal = false;
  KernelCounters counters;
  bool corrupt = false;                  ///< set when a reference leads to a node that cannot be its target
  const HitFilter* filter = nullptr;     ///< none: all hits count
  CrossingBuffer* crossings = nullptr;   ///< none: they are counted alone
  unsigned object_level = 0;             ///< of the store; 0: it has no objects
  const Footprint* footprint = nullptr;  ///< none: every subtree is entered
  bool masks = false;                    ///< the store has masked triangles
  std::uint32_t page_bytes = 0;          ///< of the store, where it has
};

/// Thread-safe; no allocation, no lock, no virtual call. A ray that is not done afterwards waits for `ray.page`.
using Kernel = void (*)(KernelContext& context, std::span<RayState> rays);

/// What a kernel for the expanded layout reads. Plain data.
struct ExpandedContext {
  ExpandedTree::View tree;
  bool need_normal = false;
  bool packets = true;  ///< coherent rays go together
  KernelCounters counters;
  const HitFilter* filter = nullptr;    ///< as above
  CrossingBuffer* crossings = nullptr;  ///< as above
  // By the place of a ray in the batch:
  std::span<const std::uint32_t> numbers = {};  ///< where there are crossings
  RayExtras extras = {};                        ///< where there is a filter
  const Hit* answers = nullptr;                 ///< the first of the batch; where there is one of these two
};

/// Traces valid rays from the root to their end. hits[i] must be a miss (Hit{}) and is the answer to rays[i]
/// afterwards; of an any-hit query t alone counts. Thread-safe; no allocation, no lock, no virtual call.
using ExpandedKernel = void (*)(ExpandedContext& context, std::span<const Ray> rays, std::span<Hit> hits);

struct KernelChoice {
  Query query = Query::closest;
  Mode mode = Mode::watertight;
  unsigned width = 8;
};

enum class Isa : std::uint8_t { scalar, avx2, avx512 };
std::string_view to_string(Isa isa);
/// Those this machine can run, best first.
std::vector<Isa> runnable_isas();

/// Null: not one of the runnable.
Kernel find_kernel(Isa isa, const KernelChoice& choice);
ExpandedKernel find_expanded_kernel(Isa isa, const KernelChoice& choice);

/// One table of kernels for each ISA, defined in kernels/.
namespace scalar {
Kernel find_kernel(const KernelChoice& choice);
ExpandedKernel find_expanded_kernel(const KernelChoice& choice);
}  // namespace scalar
namespace avx2 {
Kernel find_kernel(const KernelChoice& choice);
ExpandedKernel find_expanded_kernel(const KernelChoice& choice);
}  // namespace avx2
namespace avx512 {
Kernel find_kernel(const KernelChoice& choice);
ExpandedKernel find_expanded_kernel(const KernelChoice& choice);
}  // namespace avx512

}  // namespace raymill::traversal
