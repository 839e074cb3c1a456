// InstanceSpool: placed objects in any number, in blocks that go to disk where memory is short.
//
// The partition and the trees take an instance for a triangle with its box (stand_in) until pages are made of them.
// add() and finish() are thread-confined; after finish() read() may be called from many threads.
#pragma once

#include <cstdint>
#include <vector>

#include "storage/base/block_store.h"
#include "storage/base/status.h"
#include "storage/base/vec3.h"
#include "storage/import/scene_import.h"

namespace raymill::storage {

class InstanceSpool {
 public:
  using Placed = InstanceSink::Placed;
  explicit InstanceSpool(BlockStore& blocks) : blocks_(blocks) {}

  /// Errors: disk_full, io.
  Status add(const Placed& placed);
  /// No more come. Errors: disk_full, io.
  Status finish();
  [[nodiscard]] std::uint64_t count() const { return count_; }
  /// Errors: io.
  Result<Placed> read(std::uint64_t number) const;

 private:
  static constexpr std::size_t kPerBlock = kBlockBytes / sizeof(Placed);
  BlockStore& blocks_;
  std::vector<BlockId> written_;
  std::vector<Placed> filling_;
  std::uint64_t count_ = 0;
};

/// A triangle with the box for its bounds and `number` for its primitive id.
inline Triangle stand_in(const Aabb& box, std::uint32_t number) {
  return {{box.lower, box.upper, box.lower}, 0, number};
}

}  // namespace raymill::storage
