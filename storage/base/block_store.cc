#include "storage/base/block_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>

#include "storage/base/file_io.h"

namespace raymill::storage {

BlockStore::~BlockStore() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}

bool BlockStore::add_slab() {
  constexpr std::uint64_t kSlabBytes = kSlabBlocks * kBlockBytes;
  if (ledger_.free_bytes() < keep_free_bytes_ + kSlabBytes) {
    return false;
  }
  Result<BudgetReservation> claim = ledger_.claim(Tag::build, kSlabBytes);
  if (!claim) {
    return false;
  }
  Slab slab{std::move(*claim), MappedMemory(kSlabBytes)};
  if (slab.memory.data() == nullptr) {
    return false;
  }
  const auto first = static_cast<std::uint32_t>(slabs_.size()) * kSlabBlocks;
  slabs_.push_back(std::move(slab));
  for (std::uint32_t i = kSlabBlocks; i-- > 0;) {
    free_memory_.push_back(first + i);
  }
  return true;
}

Status BlockStore::open_file() {
  const std::string folder = folder_.empty() ? "." : folder_;
  descriptor_ = open_nameless(folder);
  if (descriptor_ < 0) {
    return {ErrorCode::io, folder + ": cannot make a temporary file: " + std::strerror(errno)};
  }
  // Blocks come back in another order than they went.
  ::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_RANDOM);
  return {};
}

Result<BlockId> BlockStore::write(std::span<const std::byte> bytes) {
  assert(bytes.size() <= kBlockBytes);
  RAYMILL_ASSIGN_OR_RETURN(const Place place, new_place());
  // Copied without the lock: a disk that takes its time holds nobody else up.
  if (place.memory != nullptr) {
    std::copy(bytes.begin(), bytes.end(), place.memory);
    return BlockId{place.number};
  }
  if (!write_fully(descriptor_, bytes, std::uint64_t(place.number) * kBlockBytes)) {
    return {write_error(errno), (folder_.empty() ? "." : folder_) + ": cannot write a temporary file: " +
                                    std::strerror(errno) + "; free some space there"};
  }
  return BlockId{place.number | kInFile};
}

Result<BlockStore::Place> BlockStore::new_place() {
  const std::lock_guard lock(mutex_);
  if (!free_memory_.empty() || add_slab()) {
    const std::uint32_t block = free_memory_.back();
    free_memory_.pop_back();
    return Place{block, in_memory(block)};
  }
  if (descriptor_ < 0) {
    RAYMILL_RETURN_IF_ERROR(open_file());
  }
  if (!free_file_.empty()) {
    const std::uint32_t block = free_file_.back();
    free_file_.pop_back();
    return Place{block, nullptr};
  }
  if (file_blocks_ == kMostBlocks) {
    return {ErrorCode::unsupported,
            "a temporary file of more than " + format_bytes(file_bytes()) + " is not supported"};
  }
  return Place{file_blocks_++, nullptr};
}

Status BlockStore::read(BlockId block, std::span<std::byte> out, std::size_t offset_in_block) const {
  const auto number = static_cast<std::uint32_t>(block);
  if ((number & kInFile) == 0) {
    const std::byte* from = nullptr;
    {
      const std::lock_guard lock(mutex_);  // write() may add a slab
      from = in_memory(number) + offset_in_block;
    }
    std::copy_n(from, out.size(), out.begin());
    return {};
  }
  const std::uint64_t offset = std::uint64_t(number & ~kInFile) * kBlockBytes + offset_in_block;
  const auto got = read_fully(descriptor_, out, offset);
  if (got != out.size()) {
    return {ErrorCode::io, (folder_.empty() ? "." : folder_) + ": cannot read a temporary file back: " +
                               (got ? "it is shorter than what was written" : std::strerror(errno))};
  }
  return {};
}

void BlockStore::release(BlockId block) {
  const std::lock_guard lock(mutex_);
  const auto number = static_cast<std::uint32_t>(block);
  if ((number & kInFile) == 0) {
    free_memory_.push_back(number);
  } else {
    free_file_.push_back(number & ~kInFile);
  }
}

}  // namespace raymill::storage
