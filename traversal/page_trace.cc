#include "traversal/page_trace.h"

#include <cstring>
#include <mutex>
#include <span>
#include <utility>
#include <vector>

#include "storage/base/atomic_file.h"

namespace raymill {
namespace {

constexpr std::size_t kBufferWords = 16 << 10;

}  // namespace

class PageTrace::Impl {
 public:
  explicit Impl(storage::AtomicFile file) : file_(std::move(file)) { words_.reserve(kBufferWords); }

  Status begin(std::uint32_t page_count, std::uint32_t frame_count) {
    const std::lock_guard lock(mutex_);
    if (begun_ || page_count >= 1U << kKindShift) {
      return {ErrorCode::unsupported, "a page trace is of one store, of less than 2^30 pages"};
    }
    begun_ = true;
    write(std::as_bytes(std::span(kMagic, sizeof kMagic - 1)));
    put(page_count);
    put(frame_count);
    return status_;
  }

  void put(Event event, std::uint32_t page) { put(static_cast<std::uint32_t>(event) << kKindShift | page); }

  Status finish() {
    const std::lock_guard lock(mutex_);
    if (!finished_) {
      flush();
      finished_ = true;
      if (status_.ok()) {
        status_ = file_.commit();
      }
    }
    return status_;
  }

  std::mutex mutex_;

 private:
  void put(std::uint32_t word) {
    words_.push_back(word);
    if (words_.size() == kBufferWords) {
      flush();
    }
  }
  void flush() {
    write(std::as_bytes(std::span(words_)));
    words_.clear();
  }
  void write(std::span<const std::byte> bytes) {
    if (status_.ok() && !finished_) {
      status_ = file_.write(bytes);
    }
  }

  storage::AtomicFile file_;
  std::vector<std::uint32_t> words_;
  Status status_;
  bool begun_ = false;
  bool finished_ = false;
};

PageTrace::PageTrace(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PageTrace::~PageTrace() = default;

Result<std::shared_ptr<PageTrace>> PageTrace::create(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile file, storage::AtomicFile::create(path));
  return std::shared_ptr<PageTrace>(new PageTrace(std::make_unique<Impl>(std::move(file))));
}

Status PageTrace::begin(std::uint32_t page_count, std::uint32_t frame_count) {
  return impl_->begin(page_count, frame_count);
}

void PageTrace::add(Event event, std::uint32_t page) {
  const std::lock_guard lock(impl_->mutex_);
  impl_->put(event, page);
}

void PageTrace::Lane::end_batch(std::uint32_t page, std::atomic<std::uint8_t>* touched) {
  // Most marks are zero, and a batch is short: eight at a time. Nobody else writes them.
  entered_.clear();
  for (std::uint32_t first = 0; first < page_count_; first += 8) {
    std::uint64_t eight = 0;
    std::memcpy(&eight, static_cast<const void*>(marks_.get() + first), sizeof eight);
    for (std::uint32_t other = first; eight != 0 && other < first + 8; ++other) {
      if (marks_[other].load(std::memory_order_relaxed) != 0) {
        marks_[other].store(0, std::memory_order_relaxed);
        touched[other].store(1, std::memory_order_relaxed);
        entered_.push_back(other);
      }
    }
  }
  const std::lock_guard lock(trace_->impl_->mutex_);
  trace_->impl_->put(Event::batch, page);
  for (const std::uint32_t other : entered_) {
    if (other != page) {
      trace_->impl_->put(Event::enter, other);
    }
  }
}

Status PageTrace::finish() { return impl_->finish(); }

}  // namespace raymill
