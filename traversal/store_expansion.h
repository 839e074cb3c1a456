// StoreExpansion: turns an open store into an expanded tree, page by page, by workers that would otherwise trace.
//
//   compact    never: pages come and go
//   expanded   before the first ray; needs the expanded bytes, and next to nothing for pages
//   automatic  where the budget holds both layouts, once the store has seen as many rays as it has triangles: about
//              then what it costs has been paid back (kernels/speed.md)
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "storage/base/aligned.h"
#include "storage/pages/codec.h"
#include "traversal/expanded_tree.h"

namespace raymill::traversal {

enum class Layout : std::uint8_t { automatic, compact, expanded };
/// "auto", "compact" or "expanded". Errors: invalid_argument.
Result<Layout> parse_layout(const std::string& name);

class StoreExpansion {
 public:
  /// What it claims: the tree, tables while it grows, and two buffers a worker.
  static std::uint64_t bytes(const storage::StoreFile& store, unsigned threads);
  /// `store` must outlive it. Errors: budget_exceeded.
  static Result<std::unique_ptr<StoreExpansion>> create(const storage::StoreFile& store, unsigned threads,
                                                        storage::Ledger& ledger);

  // Guarded by the caller's mutex:

  [[nodiscard]] bool has_pages() const { return next_page_ < store_.page_count() && status_.ok(); }
  /// A page for one worker.
  storage::PageId take();
  /// After expand(). True: it was the last one, so that finish() is due.
  bool settle(const Status& status);
  /// What went wrong, once nobody works on it.
  [[nodiscard]] const Status& status() const { return status_; }
  [[nodiscard]] bool abandoned() const { return !status_.ok() && out_ == 0; }

  // Without it:

  /// `image`: the page, where it is in memory; else it is read. Errors: of the page.
  Status expand(unsigned worker, storage::PageId page, storage::PageDecoder& decoder, const std::byte* image);
  /// Errors: corrupt.
  Result<std::unique_ptr<ExpandedTree>> finish() { return expander_->finish(); }

 private:
  using Buffer = std::vector<std::byte, storage::AlignedAllocator<std::byte, storage::kDirectBlockBytes>>;
  struct WorkerBuffers {
    Buffer encoded, frame;
  };
  explicit StoreExpansion(const storage::StoreFile& store, unsigned threads) : store_(store), buffers_(threads) {}

  const storage::StoreFile& store_;
  storage::BudgetReservation buffers_claim_;
  std::unique_ptr<TreeExpander> expander_;
  std::vector<WorkerBuffers> buffers_;
  std::uint32_t next_page_ = 0;
  unsigned out_ = 0;  // pages that workers have
  Status status_;
};

}  // namespace raymill::traversal
