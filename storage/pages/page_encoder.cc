#include "storage/pages/page_encoder.h"

#include <lz4.h>
#include <lz4hc.h>
#include <zstd.h>

#include <utility>

#include "storage/pages/draco_geometry.h"
#include "storage/pages/masked_section.h"
#include "storage/pages/page_streams.h"

namespace raymill::storage {
namespace {

EncodedHeader encoded_header(const PageHeader& header, Codec codec) {
  EncodedHeader encoded;
  encoded.page_type = header.page_type;
  encoded.codec = static_cast<std::uint8_t>(codec);
  encoded.width = header.width;
  encoded.geometry_index_bytes = header.geometry_index_bytes;
  encoded.node_count = header.node_count;
  encoded.ghost_count = header.ghost_count;
  encoded.external_count = header.external_count;
  encoded.triangle_count = header.triangle_count;
  encoded.vertex_count = header.vertex_count;
  encoded.geometry_count = header.geometry_count;
  encoded.instance_count = static_cast<std::uint16_t>(header.instance_count);
  return encoded;
}

}  // namespace

struct PageEncoder::Scratch {
  struct FreeContext {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  };
  std::vector<std::byte> streams, compressed;
  std::unique_ptr<ZSTD_CCtx, FreeContext> zstd;  // made when first needed
  std::vector<std::byte> lz4;
};

PageEncoder::PageEncoder(Codec codec, const PositionKind& positions)
    : codec_(codec), positions_(positions), scratch_(std::make_unique<Scratch>()) {}
PageEncoder::~PageEncoder() = default;
PageEncoder::PageEncoder(PageEncoder&&) noexcept = default;

std::uint64_t PageEncoder::bytes(std::uint32_t page_bytes, Codec codec) {
  // Streams and what they are compressed to are at most two pages each; zstd's tables of level 5 grow with what is
  // compressed at once, up to 3 MiB.
  const std::uint64_t context = codec == Codec::raw ? 0 : codec == Codec::lz4 ? 256 << 10 : 3 << 20;
  return context + 4 * std::uint64_t(page_bytes);
}

// The streams, in scratch memory.
std::span<const std::byte> PageEncoder::compress(Codec codec) {
  const std::vector<std::byte>& in = scratch_->streams;
  std::vector<std::byte>& out = scratch_->compressed;
  const auto reserve = [](std::vector<std::byte>& bytes, std::size_t size) {
    if (bytes.size() < size) {
      bytes.resize(size);
    }
  };
  if (codec == Codec::lz4) {
    reserve(out, static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(in.size()))));
    reserve(scratch_->lz4, static_cast<std::size_t>(LZ4_sizeofStateHC()));
    const int size = LZ4_compress_HC_extStateHC(scratch_->lz4.data(), reinterpret_cast<const char*>(in.data()),
                                                reinterpret_cast<char*>(out.data()), static_cast<int>(in.size()),
                                                static_cast<int>(out.size()), LZ4HC_CLEVEL_DEFAULT);
    return std::span(out).first(static_cast<std::size_t>(size));
  }
  if (scratch_->zstd == nullptr) {
    scratch_->zstd.reset(ZSTD_createCCtx());
  }
  reserve(out, ZSTD_compressBound(in.size()));
  return std::span(out).first(
      ZSTD_compressCCtx(scratch_->zstd.get(), out.data(), out.size(), in.data(), in.size(), kPageZstdLevel));
}

std::vector<std::byte> PageEncoder::encode(std::span<const std::byte> image) {
  const PageView view(image.data());
  std::vector<std::byte>& streams = scratch_->streams;
  streams.clear();
  Codec codec = codec_;
  std::vector<std::byte> mesh;
  std::span<const std::byte> compressed = image.subspan(sizeof(PageHeader));  // raw
  if (codec != Codec::raw) {
    write_structure(view, streams);
    if (codec == Codec::draco && view.header().triangle_count == 0) {
      codec = Codec::zstd;  // instances alone: no mesh
    }
    if (codec == Codec::draco) {
      if (auto encoded = encode_draco(view, positions_, streams); encoded) {
        mesh = std::move(*encoded);
      } else {
        codec = Codec::zstd;
      }
    }
    if (codec != Codec::draco) {
      write_geometry(view, positions_, streams);
    }
    compressed = compress(codec);
  }
  const auto mesh_bytes = static_cast<std::uint32_t>(mesh.size());
  const std::size_t mesh_part = codec == Codec::draco ? sizeof mesh_bytes + mesh.size() : 0;
  EncodedHeader header = encoded_header(view.header(), codec);
  header.streams_bytes = static_cast<std::uint32_t>(streams.size());
  const bool masked = view.header().page_type == kPageTypeMasked;
  const std::size_t mask_part = masked ? sizeof(MaskSection) : 0;
  header.payload_bytes = static_cast<std::uint32_t>(mask_part + mesh_part + compressed.size());
  std::vector<std::byte> out;
  out.reserve(sizeof header + header.payload_bytes);
  const auto append = [&out](const void* bytes, std::size_t size) {
    const auto* first = static_cast<const std::byte*>(bytes);
    out.insert(out.end(), first, first + size);
  };
  append(&header, sizeof header);
  if (masked) {
    append(&MaskSectionView(image.data()).section(), mask_part);
  }
  if (codec == Codec::draco) {
    append(&mesh_bytes, sizeof mesh_bytes);
    append(mesh.data(), mesh.size());
  }
  append(compressed.data(), compressed.size());
  return out;
}

}  // namespace raymill::storage
