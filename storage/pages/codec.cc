#include "storage/pages/codec.h"

#include <lz4.h>
#include <lz4hc.h>
#include <zstd.h>

#include <algorithm>
#include <cstring>
#include <string>

#include "storage/pages/attribute_page.h"
#include "storage/pages/draco_geometry.h"
#include "storage/pages/mask_page.h"
#include "storage/pages/masked_section.h"
#include "storage/pages/page_streams.h"
#include "storage/pages/volume_codec.h"

namespace raymill::storage {
namespace {

PageHeader page_header(const EncodedHeader& encoded) {
  PageHeader header;
  header.page_type = encoded.page_type;
  header.width = encoded.width;
  header.geometry_index_bytes = encoded.geometry_index_bytes;
  header.node_count = encoded.node_count;
  header.ghost_count = encoded.ghost_count;
  header.external_count = encoded.external_count;
  header.triangle_count = encoded.triangle_count;
  header.vertex_count = encoded.vertex_count;
  header.geometry_count = encoded.geometry_count;
  header.instance_count = encoded.instance_count;
  lay_out(header);
  return header;
}

Status corrupt(const char* what) { return {ErrorCode::corrupt, std::string("page ") + what}; }

Status check_header(const EncodedHeader& header, const PageRules& rules) {
  // Everything inside a page is numbered with 16 bits.
  constexpr std::uint32_t kMost = 0x10000;
  const bool masked = header.page_type == kPageTypeMasked && rules.masks;
  const bool type = header.page_type == (rules.proxies ? kPageTypeProxies : kPageTypeTriangles) || masked;
  const bool known = type && header.codec <= static_cast<std::uint8_t>(Codec::draco) && header.width == rules.width &&
                     header.geometry_index_bytes <= 2 && header.reserved == 0;
  const bool in_range = header.external_count <= kMost && header.triangle_count <= kMost &&
                        header.vertex_count <= kMost && header.geometry_count <= kMost;
  return known && in_range ? Status{} : corrupt("is of no known type");
}

// The counts of its masks stand before a page's payload; with them the image's size is known.
bool take_mask_section(std::span<const std::byte>& payload, PageHeader& header, MaskSection& masks) {
  if (payload.size() < sizeof masks) {
    return false;
  }
  std::memcpy(&masks, payload.data(), sizeof masks);
  payload = payload.subspan(sizeof masks);
  header.image_bytes = image_bytes_with_masks(header, masks);
  return header.image_bytes != 0;
}

Status copy_raw(std::span<const std::byte> payload, std::span<std::byte> image) {
  if (payload.size() != image.size() - sizeof(PageHeader)) {
    return corrupt("has counts that do not fit its size");
  }
  std::copy(payload.begin(), payload.end(), image.begin() + sizeof(PageHeader));
  return {};
}

// Streams are planes of the image's own fields, so they are about as large; a Draco map adds a little.
std::uint64_t streams_limit(std::uint32_t page_bytes) { return 2 * std::uint64_t(page_bytes) + 4096; }

}  // namespace

std::string_view to_string(Codec codec) {
  switch (codec) {
    case Codec::raw:
      return "raw";
    case Codec::lz4:
      return "lz4";
    case Codec::zstd:
      return "zstd";
    case Codec::draco:
      return "draco";
  }
  return "unknown";
}

std::optional<Codec> parse_codec(std::string_view text) {
  for (const Codec codec : {Codec::raw, Codec::lz4, Codec::zstd, Codec::draco}) {
    if (text == to_string(codec)) {
      return codec;
    }
  }
  return std::nullopt;
}

std::vector<std::byte> compress(std::span<const std::byte> streams, Codec codec) {
  std::vector<std::byte> out;
  if (codec == Codec::lz4) {
    out.resize(static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(streams.size()))));
    out.resize(static_cast<std::size_t>(
        LZ4_compress_HC(reinterpret_cast<const char*>(streams.data()), reinterpret_cast<char*>(out.data()),
                        static_cast<int>(streams.size()), static_cast<int>(out.size()), LZ4HC_CLEVEL_DEFAULT)));
  } else {
    out.resize(ZSTD_compressBound(streams.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), streams.data(), streams.size(), kPageZstdLevel));
  }
  return out;
}

struct PageDecoder::Scratch {
  explicit Scratch(std::size_t bytes) : streams(bytes), context(ZSTD_createDCtx()) {}
  ~Scratch() { ZSTD_freeDCtx(context); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;

  // The decompressed streams, or empty where the bytes do not give exactly `expected`.
  std::optional<std::span<const std::byte>> decompress(std::span<const std::byte> bytes, Codec codec,
                                                       std::size_t expected) {
    if (expected > streams.size()) {
      return std::nullopt;
    }
    if (codec == Codec::lz4) {
      const int size =
          LZ4_decompress_safe(reinterpret_cast<const char*>(bytes.data()), reinterpret_cast<char*>(streams.data()),
                              static_cast<int>(bytes.size()), static_cast<int>(expected));
      if (size < 0 || static_cast<std::size_t>(size) != expected) {
        return std::nullopt;
      }
    } else if (ZSTD_decompressDCtx(context, streams.data(), expected, bytes.data(), bytes.size()) != expected) {
      return std::nullopt;
    }
    return std::span<const std::byte>(streams).first(expected);
  }

  std::vector<std::byte> streams;
  ZSTD_DCtx* context;
};

PageDecoder::PageDecoder(const PageRules& rules, const PositionKind& positions, Codec store_codec)
    : rules_(rules),
      positions_(positions),
      scratch_(std::make_unique<Scratch>(store_codec == Codec::raw ? 0 : streams_limit(rules.page_bytes))) {}
PageDecoder::~PageDecoder() = default;
PageDecoder::PageDecoder(PageDecoder&&) noexcept = default;

std::uint64_t PageDecoder::scratch_bytes(std::uint32_t page_bytes, Codec store_codec) {
  // zstd's context is about 160 KiB; field vectors are at most half a page; Draco's corner tables, attributes and face
  // lists were measured at five times the page, and threads that decode side by side leave the heap so ragged that each
  // holds thirty times the page.
  constexpr std::uint64_t kContextBytes = 192 << 10;
  switch (store_codec) {
    case Codec::raw:
      return 4096;
    case Codec::lz4:
    case Codec::zstd:
      return kContextBytes + streams_limit(page_bytes) + page_bytes / 2;
    case Codec::draco:
      return kContextBytes + streams_limit(page_bytes) + 32 * std::uint64_t(page_bytes);
  }
  return 0;
}

std::uint64_t PageDecoder::process_bytes(Codec store_codec) {
  // Draco: 0.9 MiB of its library's code and data, and a heap that its many small arrays leave ragged.
  constexpr std::uint64_t kDracoBytes = 2 << 20;
  return store_codec == Codec::draco ? kDracoBytes : 0;
}

Result<std::uint32_t> PageDecoder::decode(std::span<const std::byte> encoded, std::span<std::byte> frame) {
  EncodedHeader header;
  if (encoded.size() < sizeof header) {
    return corrupt("is shorter than its header");
  }
  std::memcpy(&header, encoded.data(), sizeof header);
  if (header.page_type == kPageTypeVolume && rules_.volumes) {
    return decode_volume_page(encoded, frame, {rules_.page_bytes, rules_.page_count, rules_.geometry_count},
                              [this](std::span<const std::byte> bytes, Codec codec, std::size_t expected) {
                                return scratch_->decompress(bytes, codec, expected);
                              });
  }
  if (header.page_type == kPageTypeMask && rules_.masks) {
    return decode_mask_page(encoded, frame, rules_.page_bytes,
                            [this](std::span<const std::byte> bytes, Codec codec, std::size_t expected) {
                              return scratch_->decompress(bytes, codec, expected);
                            });
  }
  if (header.page_type == kPageTypeAttribute && rules_.attributes != 0) {
    return decode_attribute_page(encoded, frame, rules_,
                                 [this](std::span<const std::byte> bytes, Codec codec, std::size_t expected) {
                                   return scratch_->decompress(bytes, codec, expected);
                                 });
  }
  std::span<const std::byte> payload = encoded.subspan(sizeof header);
  RAYMILL_RETURN_IF_ERROR(check_header(header, rules_));
  PageHeader image_header = page_header(header);
  const bool masked = header.page_type == kPageTypeMasked;
  MaskSection masks;
  if (header.payload_bytes != payload.size() || (masked && !take_mask_section(payload, image_header, masks)) ||
      image_header.image_bytes > rules_.page_bytes || image_header.image_bytes > frame.size() ||
      header.streams_bytes > scratch_->streams.size()) {
    return corrupt("has counts that do not fit its size");
  }
  const std::span<std::byte> image = frame.first(image_header.image_bytes);
  std::memcpy(image.data(), &image_header, sizeof image_header);
  RAYMILL_RETURN_IF_ERROR(static_cast<Codec>(header.codec) == Codec::raw
                              ? copy_raw(payload, image)
                              : decode_streams(header, masked ? &masks : nullptr, payload, image));
  RAYMILL_RETURN_IF_ERROR(validate_image(image, rules_));
  return image_header.image_bytes;
}

Status PageDecoder::decode_streams(const EncodedHeader& header, const MaskSection* masks,
                                   std::span<const std::byte> payload, std::span<std::byte> image) {
  const auto codec = static_cast<Codec>(header.codec);
  // Gaps between the arrays are part of the image: pages decode to the same bytes whatever stood in the frame.
  std::memset(image.data() + sizeof(PageHeader), 0, image.size() - sizeof(PageHeader));
  if (masks != nullptr) {
    std::memcpy(image.data() + instances_end(PageView(image.data()).header()), masks, sizeof *masks);
  }
  std::span<const std::byte> mesh;
  if (codec == Codec::draco) {
    std::uint32_t mesh_bytes = 0;
    if (payload.size() < sizeof mesh_bytes || !positions_.lattice) {
      return corrupt("is shorter than its Draco mesh");
    }
    std::memcpy(&mesh_bytes, payload.data(), sizeof mesh_bytes);
    payload = payload.subspan(sizeof mesh_bytes);
    if (mesh_bytes > payload.size()) {
      return corrupt("is shorter than its Draco mesh");
    }
    mesh = payload.first(mesh_bytes);
    payload = payload.subspan(mesh_bytes);
  }
  const auto streams = scratch_->decompress(payload, codec, header.streams_bytes);
  if (!streams) {
    return corrupt("cannot be decompressed");
  }
  PlaneReader reader(*streams);
  read_structure(reader, image.data());
  if (codec == Codec::draco) {
    RAYMILL_RETURN_IF_ERROR(decode_draco(mesh, reader, positions_, image.data()));
  } else {
    read_geometry(reader, positions_, image.data());
  }
  return reader.exhausted() ? Status{} : corrupt("has streams of another length than its counts");
}

}  // namespace raymill::storage
