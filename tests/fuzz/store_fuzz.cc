// A store file from any bytes: opened or refused, never trusted. The checksums of header, footer and directory are
// made right first where they can be, so that the checks behind them are reached.

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "storage/base/checksum.h"
#include "storage/io/store_file.h"
#include "storage/pages/codec.h"
#include "storage/pages/page_assembler.h"

namespace {

using namespace raymill;
using namespace raymill::storage;

constexpr std::uint64_t kMostMetadata = 1 << 20;

void make_checksums_right(std::vector<std::byte>& file) {
  StoreHeader header;
  StoreFooter footer;
  if (file.size() < sizeof header + sizeof footer) {
    return;
  }
  std::memcpy(&header, file.data(), sizeof header);
  seal(header);
  std::memcpy(file.data(), &header, sizeof header);
  std::byte* footer_at = file.data() + file.size() - sizeof footer;
  std::memcpy(&footer, footer_at, sizeof footer);
  const std::uint64_t bytes = footer.page_count * sizeof(PageEntry);
  if (footer.page_count < file.size() && footer.directory_offset < file.size() &&
      bytes <= file.size() - footer.directory_offset) {
    footer.directory_checksum = checksum(std::span(file).subspan(footer.directory_offset, bytes));
  }
  footer.header_checksum = header.checksum;
  footer.file_bytes = file.size();
  seal(footer);
  std::memcpy(footer_at, &footer, sizeof footer);
}

void open(std::span<const std::byte> bytes) {
  const int memory = ::memfd_create("store", MFD_CLOEXEC);
  if (memory < 0 || ::write(memory, bytes.data(), bytes.size()) != static_cast<ssize_t>(bytes.size())) {
    std::abort();
  }
  Ledger ledger(gibibytes(1));
  const auto opened = StoreFile::open("/proc/self/fd/" + std::to_string(memory), ledger);
  if (opened) {
    const StoreFile& store = **opened;
    if (store.footer().metadata_plain_bytes <= kMostMetadata) {
      (void)store.read_metadata();
    }
    std::vector<std::byte, AlignedAllocator<std::byte, kDirectBlockBytes>> buffer(store.read_buffer_bytes());
    PageBuffer frame(store.header().page_bytes);
    PageDecoder decoder(store.rules(), store.positions(), store.codec());
    for (std::uint32_t page = 0; page < store.page_count() && page < 16; ++page) {
      const auto encoded = store.read_page(PageId{page}, buffer);
      if (encoded && decoder.decode(*encoded, frame)) {
        (void)check_boxes(frame.data());
      }
    }
  }
  ::close(memory);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::vector<std::byte> file(size);
  if (size > 0) {
    std::memcpy(file.data(), data, size);
  }
  open(file);
  make_checksums_right(file);
  open(file);
  return 0;
}
