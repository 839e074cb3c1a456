// RayState: a ray while a kernel works on it. RecordLayout: the same ray while it waits.
//
// In flight a ray is a record of a few dozen bytes: org, dir, tfar (the nearest hit so far), its number, the node where
// it waits and the bitstack, cut to the bytes that the store's depth needs. The page is known from the queue. The hit
// itself stands in the job's result row from the moment it is found, so the record does not carry it; tnear stands
// beside the rows, and only where a chunk has a ray whose tnear is not zero.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <vector>

#include "storage/base/types.h"
#include "traversal/query.h"

namespace raymill::traversal {

/// One mask of N bits for each level, level 0 in the low bits: children that the ray's boxes test kept and that are
/// still to be visited. This is the skip code of Afra & Szirmay-Kalos 2014 (section 3) with the circular order replaced
/// by slots in the ray's octant order, so that the next child is a table look-up.
struct Bitstack {
  std::array<std::uint64_t, 2> words{};
};
static_assert(sizeof(Bitstack) * 8 == storage::kBitstackBits);

/// What is to be done at the node where a ray stands.
enum class Resume : std::uint8_t {
  enter = 0,      ///< test the node's children
  backtrack = 1,  ///< go on with the bitstack, from this node upward
};

/// The node that a ray left for one that is not there. The image stays as long as the kernel's pages do.
struct LeftNode {
  const std::byte* image = nullptr;  ///< none: the ray has not moved
  std::uint32_t page = 0;
  std::uint16_t node = 0;
};

struct RayState {
  std::array<float, 3> org{};
  std::array<float, 3> dir{};
  float tnear = 0;
  float tfar = 0;  ///< of the nearest hit so far, else the ray's own
  std::uint32_t number = 0;
  Bitstack stack;
  std::uint32_t page = 0;
  std::uint16_t node = 0;
  Resume resume = Resume::enter;
  std::uint8_t level = 0;  ///< that the node must have
  bool has_hit = false;
  // Since the ray was taken up:
  bool improved = false;  ///< the fields below are a hit that is not yet in the row
  bool done = false;
  LeftNode left;
  Hit hit;
};

/// Bytes of a waiting ray. Immutable.
class RecordLayout {
 public:
  RecordLayout() = default;
  explicit RecordLayout(unsigned stack_bytes) : stack_bytes_(stack_bytes) {}
  static unsigned stack_bytes(unsigned width, unsigned levels) { return (width * levels + 7) / 8; }

  [[nodiscard]] std::size_t bytes() const { return kFixedBytes + stack_bytes_; }

  void pack(const RayState& ray, std::byte* record) const {
    const Fixed fixed{ray.org, ray.dir, ray.tfar, ray.number, ray.node};
    std::memcpy(record, &fixed, kFixedBytes - 1);
    record[kFixedBytes - 1] = static_cast<std::byte>(static_cast<unsigned>(ray.resume) | unsigned(ray.has_hit) << 1 |
                                                     unsigned(ray.level) << 2);
    std::memcpy(record + kFixedBytes, ray.stack.words.data(), stack_bytes_);
  }
  /// tnear and page are the caller's to set.
  void unpack(const std::byte* record, RayState& ray) const {
    Fixed fixed;
    std::memcpy(&fixed, record, kFixedBytes - 1);
    ray = {};
    ray.org = fixed.org;
    ray.dir = fixed.dir;
    ray.tfar = fixed.tfar;
    ray.number = fixed.number;
    ray.node = fixed.node;
    const auto flags = static_cast<unsigned>(record[kFixedBytes - 1]);
    ray.resume = static_cast<Resume>(flags & 1);
    ray.has_hit = (flags & 2) != 0;
    ray.level = static_cast<std::uint8_t>(flags >> 2);
    std::memcpy(ray.stack.words.data(), record + kFixedBytes, stack_bytes_);
  }

 private:
  struct Fixed {
    std::array<float, 3> org;
    std::array<float, 3> dir;
    float tfar;
    std::uint32_t number;
    std::uint16_t node;
  };
  static constexpr std::size_t kFixedBytes = 12 + 12 + 4 + 4 + 2 + 1;
  static_assert(offsetof(Fixed, node) + sizeof(std::uint16_t) == kFixedBytes - 1);
  static_assert(storage::max_levels(4) <= 1U << 6, "the level shares a byte with two flags");
  unsigned stack_bytes_ = sizeof(Bitstack);
};

/// Rows of the rays of a chunk that are still under way after the chunk's rows went to disk.
struct StragglerRows {
  std::vector<std::uint32_t> positions;  ///< in the chunk, rising
  std::vector<float> tnears;             ///< of each; none: all zero
  std::vector<std::byte> rows;
  std::size_t row_bytes = 0;

  [[nodiscard]] std::size_t index_of(std::uint32_t position) const {
    return static_cast<std::size_t>(std::lower_bound(positions.begin(), positions.end(), position) - positions.begin());
  }
};

/// Where a ray's row is. The number of a ray: the chunk's slot above, the position in the chunk below.
struct RowTable {
  unsigned chunk_shift = 0;                    ///< rays of a chunk: 2^chunk_shift
  std::size_t row_bytes = 0;                   ///< of the layout below
  HitLayout layout;                            ///< includes the ids wherever a tie could show
  std::byte* const* bases = nullptr;           ///< for each slot: its rows, or null where they are on disk
  StragglerRows* const* stragglers = nullptr;  ///< for each slot whose rows are on disk
  const float* const* tnears = nullptr;        ///< for each slot: null where all are zero

  [[nodiscard]] std::byte* row(std::uint32_t number) const {
    const std::uint32_t slot = number >> chunk_shift, position = number & ((1U << chunk_shift) - 1);
    if (bases[slot] != nullptr) {
      return bases[slot] + std::size_t(position) * row_bytes;
    }
    StragglerRows& rows = *stragglers[slot];
    return rows.rows.data() + rows.index_of(position) * row_bytes;
  }
  [[nodiscard]] float tnear(std::uint32_t number) const {
    const std::uint32_t slot = number >> chunk_shift, position = number & ((1U << chunk_shift) - 1);
    if (tnears[slot] != nullptr) {
      return tnears[slot][position];
    }
    if (bases[slot] == nullptr && stragglers[slot] != nullptr && !stragglers[slot]->tnears.empty()) {
      return stragglers[slot]->tnears[stragglers[slot]->index_of(position)];
    }
    return 0;
  }
};

}  // namespace raymill::traversal
