// GltfBuffers: the bytes of a document's buffers, wherever they lie: BIN chunk, file beside it, data: URI, meshopt
// stream.
//
// A buffer is looked for when it is first read, so one that only animations use may be missing. At most one external
// file is open at a time. Decoded data: URIs are claimed and kept; of meshopt streams the two that were read last are,
// one for the positions and one for the indices of a primitive. Thread-compatible.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/import/byte_source.h"
#include "storage/import/gltf_container.h"
#include "storage/import/gltf_document.h"

namespace raymill::storage {

class GltfBuffers {
 public:
  /// `file` is the glTF file itself and outlives this; `folder` is where relative URIs start, nothing where no external
  /// file may be read (a document in memory).
  GltfBuffers(const ByteSource& file, std::optional<ByteExtent> binary_chunk, std::optional<std::string> folder,
              std::vector<BufferDeclaration> declarations, Ledger& ledger);

  [[nodiscard]] std::uint64_t size_bytes(int buffer) const { return declarations_[index(buffer)].size_bytes; }

  /// Fills `out` from `offset` of `buffer`, which must be an index of the document.
  /// Errors: bad_scene (past the end; no data), not_found, io, unsupported (a URI that is no file), budget_exceeded.
  Status read(int buffer, std::uint64_t offset, std::span<std::byte> out);

 private:
  struct Decoded {
    BudgetReservation claim;
    std::vector<std::byte> bytes;
  };

  static std::size_t index(int buffer) { return static_cast<std::size_t>(buffer); }
  Status read_available(int buffer, std::uint64_t offset, std::span<std::byte> out);
  Status open_external(int buffer);
  Status decode(int buffer);
  Status read_meshopt(int buffer, std::uint64_t offset, std::span<std::byte> out);
  Status decode_meshopt_into(int buffer, Decoded& fresh);

  const ByteSource& file_;
  const std::optional<ByteExtent> binary_chunk_;
  const std::optional<std::string> folder_;
  std::vector<BufferDeclaration> declarations_;
  std::vector<std::optional<Decoded>> decoded_;
  Ledger& ledger_;
  struct MeshoptSlot {
    int buffer = -1;
    Decoded decoded;
  };
  std::array<MeshoptSlot, 2> meshopt_;  // the one that was read last stands first
  int external_index_ = -1;
  ByteSource external_;
};

}  // namespace raymill::storage
