#include "storage/io/page_reader.h"

#include <utility>

#include "storage/base/quotes.h"
#include "storage/io/pread_pool.h"
#include "storage/io/uring_reader.h"

namespace raymill::storage {

Result<ReaderKind> parse_reader_kind(std::string_view name) {
  if (name.empty() || name == "auto") {
    return ReaderKind::automatic;
  }
  if (name == "pread") {
    return ReaderKind::pread;
  }
  if (name != "uring") {
    return {ErrorCode::invalid_argument, in_quotes(name) + " is no way of reading pages: auto, uring, pread"};
  }
  if (const Status status = UringReader::available(); !status.ok()) {
    return {ErrorCode::invalid_argument, status.message()};
  }
  return ReaderKind::uring;
}

Result<std::unique_ptr<PageReader>> make_page_reader(std::shared_ptr<const StoreFile> file, ReaderKind kind,
                                                     unsigned depth, Ledger& ledger, ReadDone done) {
  if (kind != ReaderKind::pread) {
    auto reader = UringReader::create(file, depth, ledger, done);
    if (reader) {
      return std::unique_ptr<PageReader>(std::move(*reader));
    }
    if (kind == ReaderKind::uring || reader.status().code() != ErrorCode::unsupported) {
      return reader.status();
    }
  }
  RAYMILL_ASSIGN_OR_RETURN(auto pool, PreadPool::create(std::move(file), depth, ledger, std::move(done)));
  return std::unique_ptr<PageReader>(std::move(pool));
}

std::uint64_t page_reader_bytes(const StoreFile& file, unsigned depth) { return UringReader::bytes(file, depth); }

}  // namespace raymill::storage
