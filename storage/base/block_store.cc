#include "storage/base/block_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>

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
  descriptor_ = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
  if (descriptor_ < 0) {
    // Some file systems have no nameless files.
    std::string name = folder + "/raymill-XXXXXX.tmp";
    descriptor_ = ::mkostemps(name.data(), 4, O_CLOEXEC);
    if (descriptor_ >= 0) {
      ::unlink(name.c_str());
    }
  }
  if (descriptor_ < 0) {
    return {ErrorCode::io, folder + ": cannot make a temporary file: " + std::strerror(errno)};
  }
  // Blocks come back in another order than they went.
  ::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_RANDOM);
  return {};
}

Result<BlockId> BlockStore::write(std::span<const std::byte> bytes) {
  assert(bytes.size() <= kBlockBytes);
  const std::lock_guard lock(mutex_);
  if (!free_memory_.empty() || add_slab()) {
    const std::uint32_t block = free_memory_.back();
    free_memory_.pop_back();
    std::copy(bytes.begin(), bytes.end(), in_memory(block));
    return BlockId{block};
  }
  if (descriptor_ < 0) {
    RAYMILL_RETURN_IF_ERROR(open_file());
  }
  std::uint32_t block = file_blocks_;
  if (!free_file_.empty()) {
    block = free_file_.back();
    free_file_.pop_back();
  } else if (file_blocks_ == kMostBlocks) {
    return {ErrorCode::unsupported,
            "a temporary file of more than " + format_bytes(file_bytes()) + " is not supported"};
  } else {
    ++file_blocks_;
  }
  for (std::size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::pwrite(descriptor_, bytes.data() + done, bytes.size() - done,
                               static_cast<off_t>(std::uint64_t(block) * kBlockBytes + done));
    if (n < 0 && errno != EINTR) {
      const bool full = errno == ENOSPC || errno == EDQUOT || errno == EFBIG;
      return {full ? ErrorCode::disk_full : ErrorCode::io,
              (folder_.empty() ? "." : folder_) + ": cannot write a temporary file: " + std::strerror(errno) +
                  "; free some space there"};
    }
    done += n > 0 ? static_cast<std::size_t>(n) : 0;
  }
  return BlockId{block | kInFile};
}

Status BlockStore::read(BlockId block, std::span<std::byte> out) const {
  const auto number = static_cast<std::uint32_t>(block);
  if ((number & kInFile) == 0) {
    const std::byte* from = nullptr;
    {
      const std::lock_guard lock(mutex_);  // write() may add a slab
      from = in_memory(number);
    }
    std::copy_n(from, out.size(), out.begin());
    return {};
  }
  const std::uint64_t offset = std::uint64_t(number & ~kInFile) * kBlockBytes;
  for (std::size_t done = 0; done < out.size();) {
    const ssize_t n = ::pread(descriptor_, out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (n == 0 || (n < 0 && errno != EINTR)) {
      return {ErrorCode::io, (folder_.empty() ? "." : folder_) + ": cannot read a temporary file back: " +
                                 (n == 0 ? "it is shorter than what was written" : std::strerror(errno))};
    }
    done += n > 0 ? static_cast<std::size_t>(n) : 0;
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
