#include "storage/build/instance_spool.h"

#include <span>
#include <type_traits>

namespace raymill::storage {

static_assert(std::is_trivially_copyable_v<InstanceSpool::Placed>);

Status InstanceSpool::add(const Placed& placed) {
  filling_.reserve(kPerBlock);
  filling_.push_back(placed);
  ++count_;
  return filling_.size() == kPerBlock ? finish() : Status();
}

Status InstanceSpool::finish() {
  if (!filling_.empty()) {
    RAYMILL_ASSIGN_OR_RETURN(const BlockId block, blocks_.write(std::as_bytes(std::span(filling_))));
    written_.push_back(block);
    filling_.clear();
  }
  return {};
}

Result<InstanceSpool::Placed> InstanceSpool::read(std::uint64_t number) const {
  Placed placed;
  RAYMILL_RETURN_IF_ERROR(blocks_.read(written_[number / kPerBlock], std::as_writable_bytes(std::span(&placed, 1)),
                                       number % kPerBlock * sizeof placed));
  return placed;
}

}  // namespace raymill::storage
