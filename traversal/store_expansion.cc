#include "traversal/store_expansion.h"

#include "storage/base/quotes.h"

namespace raymill::traversal {

using storage::PageId;

Result<Layout> parse_layout(const std::string& name) {
  if (name == "auto") {
    return Layout::automatic;
  }
  if (name == "compact") {
    return Layout::compact;
  }
  if (name == "expanded") {
    return Layout::expanded;
  }
  return {ErrorCode::invalid_argument, in_quotes(name) + " is no layout; auto, compact and expanded are"};
}

namespace {

std::uint64_t buffer_bytes(const storage::StoreFile& store) {
  return store.read_buffer_bytes() + store.header().page_bytes + 2 * storage::kDirectBlockBytes;
}

}  // namespace

std::uint64_t StoreExpansion::bytes(const storage::StoreFile& store, unsigned threads) {
  return ExpandedTree::bytes(store) + TreeExpander::bytes(store) + threads * buffer_bytes(store);
}

Result<std::unique_ptr<StoreExpansion>> StoreExpansion::create(const storage::StoreFile& store, unsigned threads,
                                                               storage::Ledger& ledger) {
  std::unique_ptr<StoreExpansion> expansion(new StoreExpansion(store, threads));
  RAYMILL_ASSIGN_OR_RETURN(expansion->buffers_claim_,
                           ledger.claim(storage::Tag::decode, threads * buffer_bytes(store)));
  RAYMILL_ASSIGN_OR_RETURN(expansion->expander_, TreeExpander::create(store, ledger));
  return expansion;
}

PageId StoreExpansion::take() {
  ++out_;
  return PageId{next_page_++};
}

bool StoreExpansion::settle(const Status& status) {
  --out_;
  if (status_.ok()) {
    status_ = status;
  }
  return status_.ok() && out_ == 0 && next_page_ == store_.page_count();
}

Status StoreExpansion::expand(unsigned worker, PageId page, storage::PageDecoder& decoder, const std::byte* image) {
  if (image != nullptr) {
    return expander_->add(page, image);
  }
  WorkerBuffers& own = buffers_[worker];
  own.encoded.resize(store_.read_buffer_bytes());
  own.frame.resize(store_.header().page_bytes);
  RAYMILL_ASSIGN_OR_RETURN(const auto encoded, store_.read_page(page, own.encoded));
  RAYMILL_RETURN_IF_ERROR(store_.check_page(page, encoded));
  if (const auto size = decoder.decode(encoded, own.frame); !size) {
    return store_.page_fault(page, size.status());
  }
  return expander_->add(page, own.frame.data());
}

}  // namespace raymill::traversal
