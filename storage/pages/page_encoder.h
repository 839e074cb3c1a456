// PageEncoder: images to what stands in the file, with the memory that it takes. Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "storage/pages/codec.h"

namespace raymill::storage {

class PageEncoder {
 public:
  PageEncoder(Codec codec, const PositionKind& positions);
  ~PageEncoder();
  PageEncoder(PageEncoder&&) noexcept;

  /// Encodes a valid image; falls back to zstd where the codec is draco and Draco loses anything. The same image gives
  /// the same bytes, whatever was encoded before.
  std::vector<std::byte> encode(std::span<const std::byte> image);

  /// Memory that one encoder holds.
  static std::uint64_t bytes(std::uint32_t page_bytes, Codec codec);

 private:
  struct Scratch;
  std::span<const std::byte> compress(Codec codec);

  const Codec codec_;
  const PositionKind positions_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace raymill::storage
