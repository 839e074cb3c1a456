#include "storage/build/attribute_spool.h"

#include <algorithm>

namespace raymill::storage {

Status BlockStream::append(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    filling_.reserve(kBlockBytes);
    const auto piece = bytes.first(std::min(bytes.size(), kBlockBytes - filling_.size()));
    filling_.insert(filling_.end(), piece.begin(), piece.end());
    bytes = bytes.subspan(piece.size());
    if (filling_.size() == kBlockBytes) {
      RAYMILL_ASSIGN_OR_RETURN(const BlockId block, blocks_.write(filling_));
      written_.push_back(block);
      filling_.clear();
    }
  }
  return {};
}

Status BlockStream::read(std::uint64_t offset, std::span<std::byte> out) const {
  while (!out.empty()) {
    const std::size_t block = offset / kBlockBytes, in_block = offset % kBlockBytes;
    const auto piece = out.first(std::min(out.size(), kBlockBytes - in_block));
    if (block < written_.size()) {
      RAYMILL_RETURN_IF_ERROR(blocks_.read(written_[block], piece, in_block));
    } else {
      std::copy_n(filling_.begin() + static_cast<std::ptrdiff_t>(in_block), piece.size(), piece.begin());
    }
    offset += piece.size();
    out = out.subspan(piece.size());
  }
  return {};
}

void BlockStream::forget(std::uint64_t offset) {
  for (; released_ < std::min<std::uint64_t>(offset / kBlockBytes, written_.size()); ++released_) {
    blocks_.release(written_[released_]);
  }
}

Result<std::uint64_t> AttributeSpool::add_entries(std::span<const float> entries) {
  const std::uint64_t first = entries_.size_bytes() / (3 * corner_floats(set_) * sizeof(float));
  RAYMILL_RETURN_IF_ERROR(entries_.append(std::as_bytes(entries)));
  return first;
}

Status AttributeSpool::set_attributes(std::uint32_t geometry_id, const AttributeGeometry& geometry) {
  RAYMILL_RETURN_IF_ERROR(fill_geometries(geometry_id));
  return geometries_.append(std::as_bytes(std::span(&geometry, 1)));
}

Status AttributeSpool::fill_geometries(std::uint64_t count) {
  const AttributeGeometry none;
  while (geometries_.size_bytes() / sizeof none < count) {
    RAYMILL_RETURN_IF_ERROR(geometries_.append(std::as_bytes(std::span(&none, 1))));
  }
  return {};
}

}  // namespace raymill::storage
