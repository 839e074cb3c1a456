// StoreFile: an open store. Reading one costs a header, a footer and the page directory, whatever the size.
// Immutable after open; thread-safe.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/base/ledger.h"
#include "storage/base/status.h"
#include "storage/pages/store_format.h"

namespace raymill::storage {

/// Direct reads go in whole blocks of this size, offset and memory included.
constexpr std::uint64_t kDirectBlockBytes = 4096;

/// The whole blocks in which a page stands: what a read asks for.
struct PageBlocks {
  std::uint64_t offset = 0;  ///< in the file
  std::uint64_t bytes = 0;
  std::uint64_t skipped = 0;  ///< before the page
  std::uint64_t needed = 0;   ///< up to the page's end; the file may end before the block does
};

class StoreFile {
 public:
  /// Claims the directory from `ledger`. Errors: not_found, io, corrupt, checksum_mismatch, version_mismatch,
  /// unsupported, budget_exceeded.
  static Result<std::shared_ptr<const StoreFile>> open(const std::string& path, Ledger& ledger);
  ~StoreFile();
  StoreFile(const StoreFile&) = delete;
  StoreFile& operator=(const StoreFile&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const StoreHeader& header() const { return header_; }
  [[nodiscard]] const StoreFooter& footer() const { return footer_; }
  [[nodiscard]] std::uint32_t page_count() const { return static_cast<std::uint32_t>(directory_.size()); }
  [[nodiscard]] const PageEntry& entry(PageId page) const { return directory_[index_of(page)]; }
  [[nodiscard]] Codec codec() const { return static_cast<Codec>(header_.codec); }
  [[nodiscard]] PageRules rules() const;
  [[nodiscard]] bool has_volumes() const {
    return (header_.features & static_cast<std::uint64_t>(Feature::volumes)) != 0;
  }
  [[nodiscard]] bool has_proxies() const { return has(header_.features, Feature::proxies); }
  /// Rays of float64 find what is placed with more of org than float32 holds.
  [[nodiscard]] bool has_origins() const { return has(header_.features, Feature::origins); }
  [[nodiscard]] bool has_masks() const { return (header_.features & static_cast<std::uint64_t>(Feature::masks)) != 0; }
  [[nodiscard]] bool has_attributes() const { return header_.attributes != 0; }
  [[nodiscard]] PositionKind positions() const;
  /// "float32" or "lattice:STEP".
  [[nodiscard]] std::string positions_text() const;

  /// Whether reads bypass the page cache; where the file system refuses that, reads are buffered and the cache is
  /// told to forget them.
  [[nodiscard]] bool direct() const { return direct_; }
  /// A sentence for people where reads are not direct; else empty.
  [[nodiscard]] std::string io_note() const;
  /// Bytes of buffer that the largest page needs, block padding included.
  [[nodiscard]] std::uint64_t read_buffer_bytes() const;
  /// Reads a page's encoded bytes; blocks. `buffer` is aligned to kDirectBlockBytes and read_buffer_bytes() long.
  /// The checksum is not checked here. Errors: io.
  Result<std::span<const std::byte>> read_page(PageId page, std::span<std::byte> buffer) const;

  // The same in parts, for readers that wait elsewhere than in pread().
  [[nodiscard]] PageBlocks blocks_of(PageId page) const;
  /// Direct where the file system allows; open as long as this object.
  [[nodiscard]] int read_descriptor() const { return direct_ ? direct_descriptor_ : descriptor_; }
  /// Reads blocks of one page or of several that follow each other; how many bytes came: fewer at the file's end, none
  /// where it could not be read.
  std::uint64_t read_blocks(const PageBlocks& blocks, std::span<std::byte> buffer) const;
  /// The page's bytes in a buffer into which `bytes_read` of its blocks were read. Errors: io (the file was cut short).
  Result<std::span<const std::byte>> page_in(PageId page, std::span<const std::byte> buffer,
                                             std::uint64_t bytes_read) const;
  /// Tells the system to drop these blocks from its page cache.
  void forget(const PageBlocks& blocks) const;

  /// Reads and checks a page's bytes against the reference. Errors: checksum_mismatch.
  [[nodiscard]] Status check_page(PageId page, std::span<const std::byte> encoded) const;
  /// The metadata JSON. Errors: io, checksum_mismatch, corrupt.
  [[nodiscard]] Result<std::string> read_metadata() const;

  /// "STORE.mill, page 7": where a page's fault is reported.
  [[nodiscard]] Status page_fault(PageId page, const Status& fault) const;

 private:
  StoreFile(std::string path, int descriptor) : path_(std::move(path)), descriptor_(descriptor) {}
  Status load(Ledger& ledger);
  Status read_exactly(std::uint64_t offset, std::span<std::byte> out) const;
  [[nodiscard]] Status fault(const Status& status) const;
  void try_direct();

  std::string path_;
  int descriptor_ = -1;         // buffered
  int direct_descriptor_ = -1;  // O_DIRECT, or -1
  bool direct_ = false;
  StoreHeader header_;
  StoreFooter footer_;
  BudgetReservation reservation_;
  std::vector<PageEntry> directory_;
};

}  // namespace raymill::storage
