// Memory at an alignment that SIMD loads and direct reads need.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace raymill::storage {

template <typename T, std::size_t Alignment>
struct AlignedAllocator {
  using value_type = T;
  AlignedAllocator() = default;
  template <typename U>
  explicit AlignedAllocator(const AlignedAllocator<U, Alignment>& /*other*/) {}
  template <typename U>
  struct rebind {
    using other = AlignedAllocator<U, Alignment>;
  };
  T* allocate(std::size_t n) { return static_cast<T*>(::operator new (n * sizeof(T), std::align_val_t{Alignment})); }
  void deallocate(T* p, std::size_t /*n*/) { ::operator delete (p, std::align_val_t{Alignment}); }
  bool operator==(const AlignedAllocator&) const = default;
};

/// A page's image on the heap.
using PageBuffer = std::vector<std::byte, AlignedAllocator<std::byte, 64>>;

}  // namespace raymill::storage
