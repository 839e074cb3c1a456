#include "storage/pages/volume_codec.h"

#include <algorithm>
#include <cstring>
#include <type_traits>

#include "storage/pages/planes.h"

namespace raymill::storage {
namespace {

Status corrupt(const char* what) { return {ErrorCode::corrupt, std::string("volume page ") + what}; }

VolumePageHeader header_of(const EncodedVolumeHeader& encoded) {
  VolumePageHeader header;
  header.kind = encoded.kind;
  header.plane_bytes = encoded.plane_bytes;
  header.volume = encoded.volume;
  header.node_count = encoded.node_count;
  header.brick_count = encoded.brick_count;
  header.volume_count = encoded.volume_count;
  header.values_bytes = encoded.values_bytes;
  lay_out(header);
  return header;
}

EncodedVolumeHeader header_of(const VolumePageHeader& header, Codec codec) {
  EncodedVolumeHeader encoded;
  encoded.codec = static_cast<std::uint8_t>(codec);
  encoded.kind = header.kind;
  encoded.plane_bytes = header.plane_bytes;
  encoded.volume = header.volume;
  encoded.node_count = header.node_count;
  encoded.brick_count = header.brick_count;
  encoded.volume_count = header.volume_count;
  encoded.values_bytes = header.values_bytes;
  return encoded;
}

template <typename T>
T zigzag_of(T difference) {
  constexpr unsigned kSign = 8 * sizeof(T) - 1;
  return static_cast<T>(static_cast<T>(difference << 1) ^ static_cast<T>(T{0} - static_cast<T>(difference >> kSign)));
}
template <typename T>
T unzigzag_of(T code) {
  return static_cast<T>(static_cast<T>(code >> 1) ^ static_cast<T>(T{0} - static_cast<T>(code & 1U)));
}

template <typename T>
void put_deltas(PlaneWriter& out, std::span<const std::byte> values) {
  std::vector<T> words(values.size() / sizeof(T));
  T before = 0;
  for (std::size_t i = 0; i < words.size(); ++i) {
    T value = 0;
    std::memcpy(&value, values.data() + i * sizeof value, sizeof value);
    words[i] = zigzag_of(static_cast<T>(value - before));
    before = value;
  }
  out.put<T>(words);
}

template <typename T>
void get_deltas(PlaneReader& in, std::span<std::byte> values) {
  const std::span<T> words(reinterpret_cast<T*>(values.data()), values.size() / sizeof(T));
  in.get<T>(words);
  T before = 0;
  for (T& word : words) {
    before = static_cast<T>(before + unzigzag_of(word));
    word = before;
  }
}

// Calls use(T) with the type of so many bytes.
template <typename Use>
void with_type(unsigned bytes, Use&& use) {
  bytes == 1 ? use(std::uint8_t{}) : bytes == 2 ? use(std::uint16_t{}) : use(std::uint32_t{});
}

std::span<const std::byte> words_of(std::span<const std::byte> image, const VolumePageHeader& header) {
  return image.subspan(sizeof header, header.values_offset - sizeof header);
}

std::vector<std::byte> streams_of(std::span<const std::byte> image, const VolumePageHeader& header) {
  std::vector<std::byte> streams;
  PlaneWriter out(streams);
  const auto words = words_of(image, header);
  out.put<std::uint32_t>({reinterpret_cast<const std::uint32_t*>(words.data()), words.size() / 4});
  with_type(header.plane_bytes, [&](auto type) {
    put_deltas<decltype(type)>(out, image.subspan(header.values_offset, header.values_bytes));
  });
  return streams;
}

}  // namespace

std::vector<std::byte> encode_volume_page(std::span<const std::byte> image, Codec codec) {
  const VolumePageHeader& header = VolumePageView(image.data()).header();
  const Codec used = codec == Codec::draco ? Codec::zstd : codec;
  EncodedVolumeHeader encoded = header_of(header, used);
  std::vector<std::byte> payload;
  if (used == Codec::raw) {
    payload.assign(image.begin() + sizeof header, image.end());
  } else {
    const std::vector<std::byte> streams = streams_of(image, header);
    encoded.streams_bytes = static_cast<std::uint32_t>(streams.size());
    payload = compress(streams, used);
  }
  encoded.payload_bytes = static_cast<std::uint32_t>(payload.size());
  std::vector<std::byte> bytes(sizeof encoded + payload.size());
  std::memcpy(bytes.data(), &encoded, sizeof encoded);
  std::copy(payload.begin(), payload.end(), bytes.begin() + sizeof encoded);
  return bytes;
}

Result<std::uint32_t> decode_volume_page(std::span<const std::byte> encoded, std::span<std::byte> frame,
                                         const VolumeRules& rules, const Decompress& decompress) {
  EncodedVolumeHeader header;
  if (encoded.size() < sizeof header) {
    return corrupt("is shorter than its header");
  }
  std::memcpy(&header, encoded.data(), sizeof header);
  const auto payload = encoded.subspan(sizeof header);
  // Counts of 16 bits and what is checked here keep the layout's sums within 32 bits.
  const bool known = header.page_type == kPageTypeVolume && header.codec <= static_cast<std::uint8_t>(Codec::zstd) &&
                     (header.plane_bytes == 1 || header.plane_bytes == 2 || header.plane_bytes == 4);
  if (!known || header.payload_bytes != payload.size() || header.values_bytes > rules.page_bytes ||
      header.values_bytes % 4 != 0 || header.volume_count > most_volumes(rules.page_bytes)) {
    return corrupt("is of no known type or has counts that do not fit its size");
  }
  const VolumePageHeader image_header = header_of(header);
  if (image_header.image_bytes > rules.page_bytes || image_header.image_bytes > frame.size()) {
    return corrupt("has counts that do not fit its size");
  }
  const std::span<std::byte> image = frame.first(image_header.image_bytes);
  std::memcpy(image.data(), &image_header, sizeof image_header);
  const auto codec = static_cast<Codec>(header.codec);
  if (codec == Codec::raw) {
    if (payload.size() != image.size() - sizeof image_header) {
      return corrupt("has counts that do not fit its size");
    }
    std::copy(payload.begin(), payload.end(), image.begin() + sizeof image_header);
  } else {
    const std::uint32_t words_bytes = image_header.values_offset - sizeof image_header;
    const auto streams = header.streams_bytes == words_bytes + header.values_bytes
                             ? decompress(payload, codec, header.streams_bytes)
                             : std::nullopt;
    if (!streams) {
      return corrupt("cannot be decompressed");
    }
    PlaneReader in(*streams);
    in.get<std::uint32_t>({reinterpret_cast<std::uint32_t*>(image.data() + sizeof image_header), words_bytes / 4});
    const auto values = image.subspan(image_header.values_offset, image_header.values_bytes);
    with_type(header.plane_bytes, [&](auto type) { get_deltas<decltype(type)>(in, values); });
    const std::size_t end = image_header.values_offset + std::size_t{image_header.values_bytes};
    std::memset(image.data() + end, 0, image.size() - end);
  }
  RAYMILL_RETURN_IF_ERROR(validate_volume_image(image, rules));
  return image_header.image_bytes;
}

}  // namespace raymill::storage
