#include "storage/io/store_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <optional>
#include <span>

#include "storage/base/checksum.h"
#include "storage/base/file_io.h"

namespace raymill::storage {
namespace {

std::uint64_t round_up(std::uint64_t bytes) {
  return (bytes + kDirectBlockBytes - 1) / kDirectBlockBytes * kDirectBlockBytes;
}

}  // namespace

Result<std::shared_ptr<const StoreFile>> StoreFile::open(const std::string& path, Ledger& ledger) {
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);  // a pipe is refused, not waited for
  if (descriptor < 0) {
    const int error = errno;
    return {error == ENOENT ? ErrorCode::not_found : ErrorCode::io,
            path + ": cannot open the store: " + std::strerror(error)};
  }
  const std::shared_ptr<StoreFile> file(new StoreFile(path, descriptor));
  RAYMILL_RETURN_IF_ERROR(file->load(ledger));
  file->try_direct();
  return std::shared_ptr<const StoreFile>(file);
}

StoreFile::~StoreFile() {
  ::close(descriptor_);
  if (direct_descriptor_ >= 0) {
    ::close(direct_descriptor_);
  }
}

Status StoreFile::fault(const Status& status) const { return {status.code(), path_ + ": " + status.message()}; }

Status StoreFile::page_fault(PageId page, const Status& fault) const {
  return {fault.code(), path_ + ", page " + std::to_string(index_of(page)) + ": " + fault.message() +
                            "; restore the file or build it again"};
}

Status StoreFile::load(Ledger& ledger) {
  struct stat info {};
  if (::fstat(descriptor_, &info) != 0 || !S_ISREG(info.st_mode)) {
    return {ErrorCode::corrupt, path_ + ": is not a Raymill store but a folder or a device; name a .mill file"};
  }
  const auto file_bytes = static_cast<std::uint64_t>(info.st_size);
  if (file_bytes < sizeof header_ + sizeof footer_) {
    return {ErrorCode::corrupt, path_ + ": is too short to be a store; copy or build it again"};
  }
  RAYMILL_RETURN_IF_ERROR(read_exactly(0, std::as_writable_bytes(std::span(&header_, 1))));
  if (const Status status = check(header_); !status.ok()) {
    return fault({status.code(), status.message()});
  }
  RAYMILL_RETURN_IF_ERROR(read_exactly(file_bytes - sizeof footer_, std::as_writable_bytes(std::span(&footer_, 1))));
  if (const Status status = check(footer_, header_, file_bytes); !status.ok()) {
    return fault(status);
  }
  RAYMILL_ASSIGN_OR_RETURN(reservation_, ledger.claim(Tag::directory, footer_.page_count * sizeof(PageEntry)));
  directory_.resize(footer_.page_count);
  const auto bytes = std::as_writable_bytes(std::span(directory_));
  RAYMILL_RETURN_IF_ERROR(read_exactly(footer_.directory_offset, bytes));
  if (checksum(bytes) != footer_.directory_checksum) {
    return fault({ErrorCode::checksum_mismatch, "has a damaged page directory; restore or rebuild it"});
  }
  std::uint64_t all_bytes = 0;
  for (const PageEntry& entry : directory_) {
    if (entry.offset < sizeof(StoreHeader) || entry.offset > footer_.metadata_offset ||
        entry.encoded_bytes > footer_.max_encoded_bytes ||
        entry.encoded_bytes > footer_.metadata_offset - entry.offset || entry.decoded_bytes > header_.page_bytes) {
      return fault({ErrorCode::corrupt, "has a page directory that does not fit the file; build it again"});
    }
    all_bytes += entry.encoded_bytes;
  }
  // Pages stand in any order. Two that overlap are told apart by their checksums.
  if (all_bytes != footer_.metadata_offset - sizeof(StoreHeader)) {
    return fault({ErrorCode::corrupt, "has bytes that no page owns; build it again"});
  }
  return {};
}

void StoreFile::try_direct() {
  direct_descriptor_ = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECT);
  if (direct_descriptor_ < 0) {
    return;
  }
  // Some file systems take the flag and refuse the read.
  std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>> block(kDirectBlockBytes);
  direct_ = ::pread(direct_descriptor_, block.data(), block.size(), 0) > 0;
}

PageRules StoreFile::rules() const {
  return {header_.width,          footer_.levels, footer_.object_level, header_.page_bytes, page_count(),
          footer_.geometry_count, has_volumes(),  has_proxies(),        has_masks(),        header_.attributes};
}

PositionKind StoreFile::positions() const { return {header_.lattice != 0, header_.lattice_step_exponent}; }

std::string StoreFile::positions_text() const {
  if (header_.lattice == 0) {
    return "float32";
  }
  char text[48];
  std::snprintf(text, sizeof text, "lattice:%.9g", std::ldexp(1.0, header_.lattice_step_exponent));
  return text;
}

std::uint64_t StoreFile::read_buffer_bytes() const { return round_up(footer_.max_encoded_bytes) + kDirectBlockBytes; }

std::string StoreFile::io_note() const {
  return direct_ ? std::string()
                 : "direct reads are refused by the file system of " + path_ +
                       "; reads go through the page cache and are dropped from it";
}

PageBlocks StoreFile::blocks_of(PageId page) const {
  const PageEntry& entry = directory_[index_of(page)];
  PageBlocks blocks;
  blocks.offset = entry.offset / kDirectBlockBytes * kDirectBlockBytes;
  blocks.skipped = entry.offset - blocks.offset;
  blocks.needed = blocks.skipped + entry.encoded_bytes;
  blocks.bytes = round_up(blocks.needed);
  return blocks;
}

Result<std::span<const std::byte>> StoreFile::page_in(PageId page, std::span<const std::byte> buffer,
                                                      std::uint64_t bytes_read) const {
  const PageBlocks blocks = blocks_of(page);
  if (bytes_read < blocks.needed) {
    return {ErrorCode::io,
            path_ + ": ends inside page " + std::to_string(index_of(page)) + "; it was cut short while open"};
  }
  return buffer.subspan(blocks.skipped, blocks.needed - blocks.skipped);
}

void StoreFile::forget(const PageBlocks& blocks) const {
  ::posix_fadvise(descriptor_, static_cast<off_t>(blocks.offset), static_cast<off_t>(blocks.bytes),
                  POSIX_FADV_DONTNEED);
}

Result<std::span<const std::byte>> StoreFile::read_page(PageId page, std::span<std::byte> buffer) const {
  const PageBlocks blocks = blocks_of(page);
  const std::span<std::byte> into = buffer.first(blocks.bytes);
  std::optional<std::size_t> got;
  if (direct_) {
    got = read_fully(direct_descriptor_, into, blocks.offset);
  }
  if (!got) {
    got = read_fully(descriptor_, into, blocks.offset);
    const int error = errno;
    forget(blocks);
    errno = error;
  }
  if (!got) {
    return {ErrorCode::io,
            path_ + ": cannot read page " + std::to_string(index_of(page)) + ": " + std::strerror(errno)};
  }
  return page_in(page, buffer, *got);
}

std::uint64_t StoreFile::read_blocks(const PageBlocks& blocks, std::span<std::byte> buffer) const {
  const auto got = read_fully(read_descriptor(), buffer.first(blocks.bytes), blocks.offset);
  if (!direct_) {
    forget(blocks);
  }
  return got.value_or(0);
}

Status StoreFile::check_page(PageId page, std::span<const std::byte> encoded) const {
  if (checksum(encoded) != directory_[index_of(page)].checksum) {
    return page_fault(page, {ErrorCode::checksum_mismatch, "its bytes are not those that were written"});
  }
  return {};
}

Result<std::string> StoreFile::read_metadata() const {
  std::vector<std::byte> compressed(footer_.metadata_bytes);
  RAYMILL_RETURN_IF_ERROR(read_exactly(footer_.metadata_offset, compressed));
  if (checksum(compressed) != footer_.metadata_checksum) {
    return fault({ErrorCode::checksum_mismatch, "has damaged metadata; restore or rebuild it"});
  }
  std::string text(footer_.metadata_plain_bytes, '\0');
  if (ZSTD_decompress(text.data(), text.size(), compressed.data(), compressed.size()) != text.size()) {
    return fault({ErrorCode::corrupt, "has metadata that cannot be decompressed; rebuild it"});
  }
  return text;
}

Status StoreFile::read_exactly(std::uint64_t offset, std::span<std::byte> out) const {
  const auto got = read_fully(descriptor_, out, offset);
  if (!got) {
    return {ErrorCode::io, path_ + ": cannot read: " + std::strerror(errno)};
  }
  if (*got != out.size()) {
    return {ErrorCode::io, path_ + ": ends earlier than its size says"};
  }
  return {};
}

}  // namespace raymill::storage
