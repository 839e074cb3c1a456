#include "storage/base/mapped_memory.h"

#include <sys/mman.h>

namespace raymill::storage {

MappedMemory::MappedMemory(std::uint64_t bytes) {
  void* memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory != MAP_FAILED) {
    data_ = static_cast<std::byte*>(memory);
    bytes_ = bytes;
    // A huge page would make memory resident that was never asked for.
    ::madvise(memory, bytes, MADV_NOHUGEPAGE);
  }
}

MappedMemory::~MappedMemory() {
  if (data_ != nullptr) {
    ::munmap(data_, bytes_);
  }
}

}  // namespace raymill::storage
