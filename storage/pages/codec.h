// Codecs: a page's image to bytes on disk and back.
//
//   EncodedHeader | payload
//     raw          the image behind its header, as it is
//     lz4, zstd    one frame over the streams of page_streams.h
//     draco        u32 size | Draco mesh (edgebreaker over the integer lattice) | zstd frame over the other streams
//
// Whatever the codec, decode() gives the same image, so the same hits. A page that a codec cannot code (Draco and
// some non-manifold shapes) is stored with another one; the header of the page says which.
// Normative description: storage/FORMAT.md.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/status.h"
#include "storage/pages/page_image.h"

namespace raymill::storage {

struct MaskSection;

enum class Codec : std::uint8_t { raw = 0, lz4 = 1, zstd = 2, draco = 3 };
std::string_view to_string(Codec codec);
std::optional<Codec> parse_codec(std::string_view text);

/// How positions are kept: exact float32, or multiples of 2^step_exponent that fit 32 bits.
struct PositionKind {
  bool lattice = false;
  std::int32_t step_exponent = 0;
};

struct EncodedHeader {
  std::uint16_t page_type = kPageTypeTriangles;
  std::uint8_t codec = 0;
  std::uint8_t width = 0;
  std::uint8_t geometry_index_bytes = 0;
  std::uint8_t reserved = 0;
  std::uint16_t instance_count = 0;
  std::uint16_t node_count = 0;
  std::uint16_t ghost_count = 0;
  std::uint32_t external_count = 0;
  std::uint32_t triangle_count = 0;
  std::uint32_t vertex_count = 0;
  std::uint32_t geometry_count = 0;
  std::uint32_t streams_bytes = 0;  ///< before compression
  std::uint32_t payload_bytes = 0;  ///< behind this header
};
static_assert(sizeof(EncodedHeader) == 36 && std::is_trivially_copyable_v<EncodedHeader>);

constexpr int kPageZstdLevel = 5;
/// Streams of a page as one LZ4 block or zstd frame. For kinds of pages that are few: PageEncoder keeps its memory from
/// page to page. Thread-safe.
std::vector<std::byte> compress(std::span<const std::byte> streams, Codec codec);

/// Decoder with its scratch memory. Thread-confined.
class PageDecoder {
 public:
  PageDecoder(const PageRules& rules, const PositionKind& positions, Codec store_codec);
  ~PageDecoder();
  PageDecoder(PageDecoder&&) noexcept;

  /// Decodes `encoded` to `frame` (rules.page_bytes long, aligned to 64) and validates the image. Returns its size.
  /// Errors: corrupt. The frame's contents are then undefined.
  Result<std::uint32_t> decode(std::span<const std::byte> encoded, std::span<std::byte> frame);

  /// Bytes of scratch that one decoder may hold.
  static std::uint64_t scratch_bytes(std::uint32_t page_bytes, Codec store_codec);
  /// Bytes that the first page of a codec brings into the process, whatever the number of decoders.
  static std::uint64_t process_bytes(Codec store_codec);

 private:
  struct Scratch;
  Status decode_streams(const EncodedHeader& header, const MaskSection* masks, std::span<const std::byte> payload,
                        std::span<std::byte> image);

  PageRules rules_;
  PositionKind positions_;
  std::unique_ptr<Scratch> scratch_;
};

}  // namespace raymill::storage
