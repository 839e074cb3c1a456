// Pages of volumes to bytes on disk and back: EncodedVolumeHeader | payload, a frame over two streams, or raw.
//
//   words    the image from its header to its values, 4-byte planes
//   values   zigzag deltas of 1, 2 or 4 bytes in planes
//
// Normative description: storage/FORMAT.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "storage/base/status.h"
#include "storage/pages/codec.h"
#include "storage/volume/volume_page.h"

namespace raymill::storage {

struct EncodedVolumeHeader {
  std::uint16_t page_type = kPageTypeVolume;
  std::uint8_t codec = 0;
  VolumePageKind kind = VolumePageKind::bricks;
  std::uint8_t plane_bytes = 4;
  std::array<std::uint8_t, 3> reserved{};
  std::uint32_t volume = 0;
  std::uint16_t node_count = 0;
  std::uint16_t brick_count = 0;
  std::uint32_t volume_count = 0;
  std::uint32_t values_bytes = 0;
  std::uint32_t streams_bytes = 0;  ///< before compression; raw: 0
  std::uint32_t payload_bytes = 0;  ///< behind this header
  std::uint32_t reserved_too = 0;
};
static_assert(sizeof(EncodedVolumeHeader) == sizeof(EncodedHeader));

/// Encodes a valid image. Volumes have no triangles for Draco to code: zstd stands in for it.
std::vector<std::byte> encode_volume_page(std::span<const std::byte> image, Codec codec);

/// Gives the decompressed streams, of exactly so many bytes, or nothing.
using Decompress = std::function<std::optional<std::span<const std::byte>>(std::span<const std::byte> bytes,
                                                                           Codec codec, std::size_t expected)>;

/// Decodes to `frame` and validates the image. Returns its size. Errors: corrupt; the frame is undefined then.
Result<std::uint32_t> decode_volume_page(std::span<const std::byte> encoded, std::span<std::byte> frame,
                                         const VolumeRules& rules, const Decompress& decompress);

}  // namespace raymill::storage
