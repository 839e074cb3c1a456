#include "storage/pages/mask_page.h"

#include <algorithm>
#include <cstring>
#include <string>

#include "storage/pages/codec.h"

namespace raymill::storage {
namespace {

struct EncodedMaskHeader {
  std::uint16_t page_type = kPageTypeMask;
  std::uint8_t codec = 0;
  std::uint8_t bits = 1;
  std::uint32_t tile_count = 0;
  std::array<std::uint8_t, 16> reserved{};
  std::uint32_t streams_bytes = 0;  ///< before compression; raw: 0
  std::uint32_t payload_bytes = 0;
  std::uint32_t reserved_too = 0;
};
static_assert(sizeof(EncodedMaskHeader) == sizeof(EncodedHeader));

Status bad_mask_page(const char* what) { return {ErrorCode::corrupt, std::string("page of masks ") + what}; }

}  // namespace

std::vector<std::byte> make_mask_page(std::uint32_t bits, std::span<const std::byte> tiles) {
  MaskPageHeader header;
  header.bits = static_cast<std::uint8_t>(bits);
  header.tile_count = static_cast<std::uint32_t>(tiles.size() / tile_bytes(bits));
  header.image_bytes = static_cast<std::uint32_t>(sizeof header + tiles.size());
  std::vector<std::byte> image(header.image_bytes);
  std::memcpy(image.data(), &header, sizeof header);
  std::copy(tiles.begin(), tiles.end(), image.begin() + sizeof header);
  return image;
}

std::vector<std::byte> encode_mask_page(std::span<const std::byte> image, Codec codec) {
  const MaskPageHeader& header = MaskPageView(image.data()).header();
  const Codec used = codec == Codec::draco ? Codec::zstd : codec;
  const auto tiles = image.subspan(sizeof header);
  const std::vector<std::byte> payload =
      used == Codec::raw ? std::vector<std::byte>(tiles.begin(), tiles.end()) : compress(tiles, used);
  EncodedMaskHeader encoded;
  encoded.codec = static_cast<std::uint8_t>(used);
  encoded.bits = header.bits;
  encoded.tile_count = header.tile_count;
  encoded.streams_bytes = used == Codec::raw ? 0 : static_cast<std::uint32_t>(tiles.size());
  encoded.payload_bytes = static_cast<std::uint32_t>(payload.size());
  std::vector<std::byte> bytes(sizeof encoded + payload.size());
  std::memcpy(bytes.data(), &encoded, sizeof encoded);
  std::copy(payload.begin(), payload.end(), bytes.begin() + sizeof encoded);
  return bytes;
}

Result<std::uint32_t> decode_mask_page(
    std::span<const std::byte> encoded, std::span<std::byte> frame, std::uint32_t page_bytes,
    const std::function<std::optional<std::span<const std::byte>>(std::span<const std::byte> bytes, Codec codec,
                                                                  std::size_t expected)>& decompress) {
  EncodedMaskHeader header;
  if (encoded.size() < sizeof header) {
    return bad_mask_page("is shorter than its header");
  }
  std::memcpy(&header, encoded.data(), sizeof header);
  const auto payload = encoded.subspan(sizeof header);
  const bool known = header.page_type == kPageTypeMask && header.codec <= static_cast<std::uint8_t>(Codec::zstd) &&
                     (header.bits == 1 || header.bits == 8 || header.bits == 16);
  if (!known || header.tile_count == 0 || header.tile_count > tiles_per_page(header.bits, page_bytes) ||
      header.payload_bytes != payload.size()) {
    return bad_mask_page("is of no known type or has counts that do not fit its size");
  }
  const std::size_t tiles = std::size_t{header.tile_count} * tile_bytes(header.bits);
  MaskPageHeader image;
  image.bits = header.bits;
  image.tile_count = header.tile_count;
  image.image_bytes = static_cast<std::uint32_t>(sizeof image + tiles);
  if (image.image_bytes > frame.size()) {
    return bad_mask_page("has counts that do not fit its size");
  }
  const auto codec = static_cast<Codec>(header.codec);
  std::span<const std::byte> texels = payload;
  if (codec != Codec::raw) {
    const auto plain = header.streams_bytes == tiles ? decompress(payload, codec, tiles) : std::nullopt;
    if (!plain) {
      return bad_mask_page("cannot be decompressed");
    }
    texels = *plain;
  }
  if (texels.size() != tiles) {
    return bad_mask_page("has counts that do not fit its size");
  }
  std::memcpy(frame.data(), &image, sizeof image);
  std::copy(texels.begin(), texels.end(), frame.begin() + sizeof image);
  return image.image_bytes;
}

}  // namespace raymill::storage
