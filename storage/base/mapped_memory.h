// MappedMemory: a large array straight from the system. Untouched parts cost nothing; all of it goes back at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>

namespace raymill::storage {

class MappedMemory {
 public:
  MappedMemory() = default;
  enum class Pages : std::uint8_t {
    small,  ///< nothing is resident that was never touched
    huge,   ///< fewer misses of the TLB; untouched parts beside touched ones become resident, up to `bytes` in all
  };
  /// Null data() where the system refuses.
  explicit MappedMemory(std::uint64_t bytes, Pages pages = Pages::small);
  MappedMemory(MappedMemory&& other) noexcept { swap(other); }
  MappedMemory& operator=(MappedMemory&& other) noexcept {
    MappedMemory(std::move(other)).swap(*this);
    return *this;
  }
  MappedMemory(const MappedMemory&) = delete;
  MappedMemory& operator=(const MappedMemory&) = delete;
  ~MappedMemory();

  [[nodiscard]] std::byte* data() const { return data_; }
  [[nodiscard]] std::uint64_t size() const { return bytes_; }

 private:
  void swap(MappedMemory& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(bytes_, other.bytes_);
  }
  std::byte* data_ = nullptr;
  std::uint64_t bytes_ = 0;
};

}  // namespace raymill::storage
