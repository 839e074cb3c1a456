#include "storage/import/gltf_buffers.h"

#include <cctype>
#include <cstring>
#include <utility>

#include "storage/import/data_uri.h"
#include "storage/import/message.h"
#include "storage/import/release.h"

namespace raymill::storage {

namespace {

// "http:", "file:": a letter, then letters, digits, + - . up to a colon (RFC 3986, 3.1).
bool has_scheme(std::string_view uri) {
  const std::size_t colon = uri.find(':');
  if (colon == std::string_view::npos || colon == 0 || std::isalpha(static_cast<unsigned char>(uri[0])) == 0) {
    return false;
  }
  for (const char c : uri.substr(0, colon)) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '+' && c != '-' && c != '.') {
      return false;
    }
  }
  return true;
}

Status too_short(std::uint64_t declared, std::string_view what, std::uint64_t found) {
  return bad_scene("declares ", declared, " bytes and ", what, " holds ", found,
                   "; the file is damaged or was cut short");
}

}  // namespace

GltfBuffers::GltfBuffers(const ByteSource& file, std::optional<ByteExtent> binary_chunk,
                         std::optional<std::string> folder, std::vector<BufferDeclaration> declarations, Ledger& ledger)
    : file_(file),
      binary_chunk_(binary_chunk),
      folder_(std::move(folder)),
      declarations_(std::move(declarations)),
      decoded_(declarations_.size()),
      ledger_(ledger) {}

Status GltfBuffers::read(int buffer, std::uint64_t offset, std::span<std::byte> out) {
  if (offset > size_bytes(buffer) || out.size() > size_bytes(buffer) - offset) {
    return bad_scene("buffers[", buffer, "] is read at bytes ", offset, "..", offset + out.size(),
                     " and declares only ", size_bytes(buffer));
  }
  if (out.empty()) {
    return {};
  }
  Status status = read_available(buffer, offset, out);
  return status.ok() ? status : in_context(message("buffers[", buffer, "]"), status);
}

Status GltfBuffers::read_available(int buffer, std::uint64_t offset, std::span<std::byte> out) {
  const BufferDeclaration& declaration = declarations_[index(buffer)];
  if (declaration.uri.empty() && !decoded_[index(buffer)]) {
    if (buffer == 0 && binary_chunk_) {
      if (binary_chunk_->size_bytes < declaration.size_bytes) {
        return too_short(declaration.size_bytes, "the GLB's binary chunk", binary_chunk_->size_bytes);
      }
      return file_.read(binary_chunk_->offset + offset, out);
    }
    if (declaration.meshopt_fallback) {
      return {ErrorCode::unsupported,
              "holds no data but a promise of EXT_meshopt_compression, which Raymill does not read; export without it"};
    }
    return bad_scene("has neither a uri nor a binary chunk; its data is missing");
  }
  if (decoded_[index(buffer)] || is_data_uri(declaration.uri)) {
    RAYMILL_RETURN_IF_ERROR(decode(buffer));
    std::memcpy(out.data(), decoded_[index(buffer)]->bytes.data() + offset, out.size());
    return {};
  }
  RAYMILL_RETURN_IF_ERROR(open_external(buffer));
  return external_.read(offset, out);
}

Status GltfBuffers::open_external(int buffer) {
  if (external_index_ == buffer) {
    return {};
  }
  const BufferDeclaration& declaration = declarations_[index(buffer)];
  if (has_scheme(declaration.uri) || declaration.uri.starts_with('/') || !folder_) {
    return {ErrorCode::unsupported,
            "points outside of the scene's folder; only relative file names and data: are read"};
  }
  const std::optional<std::string> name = percent_decode(declaration.uri);
  if (!name || name->find('\0') != std::string::npos) {
    return bad_scene("has a uri that is not a file name");
  }
  RAYMILL_ASSIGN_OR_RETURN(ByteSource source, ByteSource::open(*folder_ + *name));
  if (source.size_bytes() < declaration.size_bytes) {
    return too_short(declaration.size_bytes, *name, source.size_bytes());
  }
  external_ = std::move(source);
  external_index_ = buffer;
  return {};
}

Status GltfBuffers::decode(int buffer) {
  std::optional<Decoded>& decoded = decoded_[index(buffer)];
  if (decoded) {
    return {};
  }
  BufferDeclaration& declaration = declarations_[index(buffer)];
  Decoded fresh;
  RAYMILL_ASSIGN_OR_RETURN(fresh.claim, ledger_.claim(Tag::build, data_uri_bytes_max(declaration.uri)));
  std::optional<std::vector<std::byte>> bytes = decode_data_uri(declaration.uri);
  if (!bytes) {
    return bad_scene("has a data: uri that is not base64");
  }
  if (bytes->size() < declaration.size_bytes) {
    return too_short(declaration.size_bytes, "its data: uri", bytes->size());
  }
  fresh.bytes = std::move(*bytes);
  decoded = std::move(fresh);
  release(declaration.uri);
  declaration.uri_claim = {};
  return {};
}

}  // namespace raymill::storage
