// AttributeSpool: entries of triangles, and where each geometry's are, in blocks that go to disk where memory is short.
//
// Both are written front to back while a scene comes in, and read front to back when its pages are made.
// Thread-confined.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "storage/base/attribute.h"
#include "storage/base/block_store.h"
#include "storage/base/status.h"

namespace raymill::storage {

/// Bytes that are only appended.
class BlockStream {
 public:
  explicit BlockStream(BlockStore& blocks) : blocks_(blocks) {}

  [[nodiscard]] std::uint64_t size_bytes() const { return written_.size() * kBlockBytes + filling_.size(); }
  /// Errors: disk_full, io.
  Status append(std::span<const std::byte> bytes);
  /// Bytes from `offset` on, which must be there. Errors: io.
  Status read(std::uint64_t offset, std::span<std::byte> out) const;
  /// Blocks before `offset` are not read again.
  void forget(std::uint64_t offset);
  /// Memory that it holds beside the table of its blocks.
  static constexpr std::uint64_t bytes() { return kBlockBytes; }

 private:
  BlockStore& blocks_;
  std::vector<BlockId> written_;
  std::size_t released_ = 0;
  std::vector<std::byte> filling_;
};

class AttributeSpool {
 public:
  AttributeSpool(BlockStore& blocks, AttributeSet set) : set_(set), entries_(blocks), geometries_(blocks) {}

  [[nodiscard]] AttributeSet set() const { return set_; }
  [[nodiscard]] bool empty() const { return entries_.size_bytes() == 0; }
  [[nodiscard]] static constexpr std::uint64_t bytes() { return 2 * BlockStream::bytes(); }

  /// Errors: disk_full, io.
  Result<std::uint64_t> add_entries(std::span<const float> entries);
  Status set_attributes(std::uint32_t geometry_id, const AttributeGeometry& geometry);
  /// Geometries up to this many have an item.
  Status fill_geometries(std::uint64_t count);

  [[nodiscard]] BlockStream& entries() { return entries_; }
  [[nodiscard]] BlockStream& geometries() { return geometries_; }

 private:
  const AttributeSet set_;
  BlockStream entries_, geometries_;
};

}  // namespace raymill::storage
