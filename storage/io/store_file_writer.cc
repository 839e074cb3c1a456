#include "storage/io/store_file_writer.h"

#include <zstd.h>

#include <algorithm>

#include "storage/base/checksum.h"

namespace raymill::storage {
namespace {

constexpr int kMetadataLevel = 9;

template <typename T>
std::span<const std::byte> bytes_of(const T& value) {
  return std::as_bytes(std::span(&value, 1));
}

}  // namespace

Result<StoreFileWriter> StoreFileWriter::create(const std::string& path, StoreHeader header) {
  seal(header);
  RAYMILL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path));
  StoreFileWriter writer(std::move(file), header);
  RAYMILL_RETURN_IF_ERROR(writer.file_.write(bytes_of(writer.header_)));
  return writer;
}

Status StoreFileWriter::add_page(PageId page, std::span<const std::byte> encoded, std::uint32_t decoded_bytes) {
  if (index_of(page) >= directory_.size()) {
    directory_.resize(index_of(page) + std::size_t{1});
  }
  PageEntry& entry = directory_[index_of(page)];
  entry.offset = file_.written_bytes();
  entry.checksum = checksum(encoded);
  entry.encoded_bytes = static_cast<std::uint32_t>(encoded.size());
  entry.decoded_bytes = decoded_bytes;
  decoded_bytes_ += decoded_bytes;
  max_encoded_bytes_ = std::max(max_encoded_bytes_, entry.encoded_bytes);
  return file_.write(encoded);
}

Status StoreFileWriter::finish(StoreFooter footer, const std::string& metadata_json) {
  std::vector<std::byte> metadata(ZSTD_compressBound(metadata_json.size()));
  metadata.resize(
      ZSTD_compress(metadata.data(), metadata.size(), metadata_json.data(), metadata_json.size(), kMetadataLevel));
  footer.header_checksum = header_.checksum;
  footer.metadata_offset = file_.written_bytes();
  footer.metadata_bytes = metadata.size();
  footer.metadata_plain_bytes = metadata_json.size();
  footer.metadata_checksum = checksum(metadata);
  RAYMILL_RETURN_IF_ERROR(file_.write(metadata));
  const auto directory = std::as_bytes(std::span(directory_));
  footer.directory_offset = file_.written_bytes();
  footer.directory_checksum = checksum(directory);
  footer.page_count = directory_.size();
  RAYMILL_RETURN_IF_ERROR(file_.write(directory));
  footer.decoded_bytes = decoded_bytes_;
  footer.max_encoded_bytes = max_encoded_bytes_;
  footer.file_bytes = file_.written_bytes() + sizeof footer;
  seal(footer);
  RAYMILL_RETURN_IF_ERROR(file_.write(bytes_of(footer)));
  return file_.commit();
}

}  // namespace raymill::storage
