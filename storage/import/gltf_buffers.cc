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
  if (declarations_[index(buffer)].meshopt) {
    return read_meshopt(buffer, offset, out);
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
      return bad_scene("holds no data: it stands for what EXT_meshopt_compression gives, and is read without it");
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

Status GltfBuffers::read_meshopt(int buffer, std::uint64_t offset, std::span<std::byte> out) {
  if (meshopt_[0].buffer != buffer) {
    std::swap(meshopt_[0], meshopt_[1]);
  }
  MeshoptSlot& slot = meshopt_[0];
  if (slot.buffer != buffer) {
    slot = {};
    Decoded fresh;
    Status status = decode_meshopt_into(buffer, fresh);
    if (status.code() == ErrorCode::budget_exceeded && meshopt_[1].buffer >= 0) {
      meshopt_[1] = {};
      status = decode_meshopt_into(buffer, fresh);
    }
    RAYMILL_RETURN_IF_ERROR(status);
    slot.buffer = buffer;
    slot.decoded = std::move(fresh);
  }
  std::memcpy(out.data(), slot.decoded.bytes.data() + offset, out.size());
  return {};
}

// Stream and result stand side by side; the decoders of indices and of vertices take nothing else from the heap.
Status GltfBuffers::decode_meshopt_into(int buffer, Decoded& fresh) {
  const MeshoptView& view = *declarations_[index(buffer)].meshopt;
  Decoded stream;
  for (const auto& [part, bytes] : {std::pair(&stream, view.size_bytes), std::pair(&fresh, view.decoded_bytes())}) {
    Result<BudgetReservation> claim = ledger_.claim(Tag::build, bytes);
    if (!claim.ok()) {
      fresh = {};
      return in_context(message("a compressed bufferView of ", view.decoded_bytes(), " bytes must be held in memory"),
                        claim.status());
    }
    part->claim = std::move(claim).value();
  }
  stream.bytes.resize(view.size_bytes);
  RAYMILL_RETURN_IF_ERROR(read(view.buffer, view.offset, stream.bytes));
  fresh.bytes.resize(view.decoded_bytes());
  return decode_meshopt(view, stream.bytes, fresh.bytes);
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
