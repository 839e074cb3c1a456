// Byte planes: the k-th bytes of all values stand together, which is what lz4 and zstd compress well.
// PlaneReader never reads past its span: a stream that is too short leaves it in the failed state. Thread-confined.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace raymill::storage {

/// Small magnitudes to small codes: 0, -1, 1, -2, ... become 0, 1, 2, 3, ...
constexpr std::uint32_t zigzag(std::uint32_t difference) { return difference << 1 ^ (0U - (difference >> 31)); }
constexpr std::uint32_t unzigzag(std::uint32_t code) { return code >> 1 ^ (0U - (code & 1)); }
constexpr std::uint16_t zigzag16(std::uint16_t difference) {
  return static_cast<std::uint16_t>(difference << 1 ^ (0U - (difference >> 15)));
}
constexpr std::uint16_t unzigzag16(std::uint16_t code) {
  return static_cast<std::uint16_t>(code >> 1 ^ (0U - (code & 1U)));
}
static_assert(unzigzag(zigzag(0x80000000U)) == 0x80000000U && zigzag(0xFFFFFFFFU) == 1 && zigzag(1) == 2);
static_assert(unzigzag16(zigzag16(0x8000U)) == 0x8000U && zigzag16(0xFFFFU) == 1);

class PlaneWriter {
 public:
  explicit PlaneWriter(std::vector<std::byte>& out) : out_(out) {}
  template <typename T>
  void put(std::span<const T> values) {
    const std::size_t begin = out_.size();
    out_.resize(begin + values.size() * sizeof(T));
    for (std::size_t k = 0; k < sizeof(T); ++k) {
      for (std::size_t i = 0; i < values.size(); ++i) {
        out_[begin + k * values.size() + i] = static_cast<std::byte>(values[i] >> (8 * k));
      }
    }
  }

 private:
  std::vector<std::byte>& out_;
};

class PlaneReader {
 public:
  explicit PlaneReader(std::span<const std::byte> in) : in_(in) {}
  template <typename T>
  void get(std::span<T> values) {
    const std::size_t count = values.size();
    if (count > (in_.size() - at_) / sizeof(T)) {
      failed_ = true;
      std::fill(values.begin(), values.end(), T{0});
      return;
    }
    const auto* planes = reinterpret_cast<const std::uint8_t*>(in_.data() + at_);
    for (std::size_t i = 0; i < count; ++i) {
      std::uint32_t value = 0;
      for (std::size_t k = 0; k < sizeof(T); ++k) {
        value |= std::uint32_t(planes[k * count + i]) << (8 * k);
      }
      values[i] = static_cast<T>(value);
    }
    at_ += count * sizeof(T);
  }
  /// Everything was there and everything was read.
  [[nodiscard]] bool exhausted() const { return !failed_ && at_ == in_.size(); }
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  std::span<const std::byte> in_;
  std::size_t at_ = 0;
  bool failed_ = false;
};

}  // namespace raymill::storage
