#include "storage/build/triangle_bucket.h"

#include <utility>

namespace raymill::storage {

Status BucketWriter::flush() {
  if (buffer_.empty()) {
    return {};
  }
  RAYMILL_ASSIGN_OR_RETURN(const BlockId block, store_.write(std::as_bytes(std::span(buffer_))));
  bucket_.blocks.push_back(block);
  buffer_.clear();
  return {};
}

Result<TriangleBucket> BucketWriter::take() {
  RAYMILL_RETURN_IF_ERROR(flush());
  buffer_ = std::vector<Triangle>();  // = {} would keep its memory
  return std::exchange(bucket_, {});
}

Status load(BlockStore& store, const TriangleBucket& bucket, std::vector<Triangle>& triangles) {
  triangles.resize(bucket.count);
  std::size_t first = 0;
  for (std::size_t i = 0; i < bucket.blocks.size(); ++i) {
    const auto block = std::span(triangles).subspan(first, bucket.in_block(i));
    RAYMILL_RETURN_IF_ERROR(store.read(bucket.blocks[i], std::as_writable_bytes(block)));
    store.release(bucket.blocks[i]);
    first += block.size();
  }
  return {};
}

}  // namespace raymill::storage
