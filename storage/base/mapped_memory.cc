#include "storage/base/mapped_memory.h"

#include <sys/mman.h>

namespace raymill::storage {

MappedMemory::MappedMemory(std::uint64_t bytes, Pages pages) {
  void* memory = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory != MAP_FAILED) {
    data_ = static_cast<std::byte*>(memory);
    bytes_ = bytes;
    ::madvise(memory, bytes, pages == Pages::huge ? MADV_HUGEPAGE : MADV_NOHUGEPAGE);
  }
}

MappedMemory::~MappedMemory() {
  if (data_ != nullptr) {
    ::munmap(data_, bytes_);
  }
}

}  // namespace raymill::storage
