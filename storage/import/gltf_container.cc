#include "storage/import/gltf_container.h"

#include <array>
#include <cstring>

#include "storage/import/message.h"

namespace raymill::storage {

namespace {

constexpr std::uint32_t kMagic = 0x46546C67;      // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;  // "JSON"
constexpr std::uint32_t kBinChunk = 0x004E4942;   // "BIN\0"
constexpr std::uint64_t kHeaderBytes = 12;
constexpr std::uint64_t kChunkHeaderBytes = 8;

// Little-endian words, as the format and every machine we build for have them.
template <std::size_t kCount>
Result<std::array<std::uint32_t, kCount>> read_words(const ByteSource& file, std::uint64_t offset) {
  std::array<std::uint32_t, kCount> words{};
  RAYMILL_RETURN_IF_ERROR(file.read(offset, std::as_writable_bytes(std::span(words))));
  return words;
}

}  // namespace

Result<GltfContainer> read_container(const ByteSource& file) {
  GltfContainer container;
  container.json.size_bytes = file.size_bytes();
  if (file.size_bytes() < sizeof kMagic) {
    return bad_scene("holds only ", file.size_bytes(), " bytes; no glTF file is that short");
  }
  RAYMILL_ASSIGN_OR_RETURN(const auto magic, read_words<1>(file, 0));
  if (magic[0] != kMagic) {
    return container;  // JSON text
  }
  if (file.size_bytes() < kHeaderBytes) {
    return bad_scene("the GLB header takes ", kHeaderBytes, " bytes and the file has ", file.size_bytes(),
                     "; it was cut short");
  }
  RAYMILL_ASSIGN_OR_RETURN(const auto header, read_words<3>(file, 0));
  if (header[1] != 2) {
    return Status(ErrorCode::unsupported,
                  message("is GLB version ", header[1], "; Raymill reads version 2, so export it as glTF 2.0"));
  }
  const std::uint64_t end = header[2];
  if (end > file.size_bytes()) {
    return bad_scene("the GLB header says ", end, " bytes and the file has ", file.size_bytes(), "; it was cut short");
  }

  bool have_json = false;
  for (std::uint64_t offset = kHeaderBytes, index = 0; offset < end; ++index) {
    if (end - offset < kChunkHeaderBytes) {
      return bad_scene("chunk ", index, " of the GLB starts at byte ", offset, " of ", end,
                       ", too late for its header");
    }
    RAYMILL_ASSIGN_OR_RETURN(const auto chunk, read_words<2>(file, offset));
    const ByteExtent extent{offset + kChunkHeaderBytes, chunk[0]};
    if (extent.size_bytes > end - extent.offset) {
      return bad_scene("chunk ", index, " of the GLB takes bytes ", extent.offset, "..",
                       extent.offset + extent.size_bytes, " of ", end, "; the file is damaged or was cut short");
    }
    if ((index == 0) != (chunk[1] == kJsonChunk)) {
      return bad_scene("chunk ", index, " of the GLB ", index == 0 ? "is not JSON" : "is a second JSON chunk");
    }
    if (chunk[1] == kJsonChunk) {
      container.json = extent;
      have_json = true;
    } else if (chunk[1] == kBinChunk) {
      if (index != 1) {
        return bad_scene("chunk ", index, " of the GLB is BIN; only the chunk after JSON may be");
      }
      container.binary = extent;
    }
    offset = extent.offset + extent.size_bytes;
  }
  if (!have_json) {
    return bad_scene("the GLB holds no JSON chunk");
  }
  return container;
}

}  // namespace raymill::storage
