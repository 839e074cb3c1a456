#include "traversal/timeline.h"

#include <cinttypes>
#include <cstdio>
#include <mutex>
#include <span>
#include <utility>

#include "storage/base/atomic_file.h"

namespace raymill {
namespace {

constexpr std::size_t kBufferBytes = 64 << 10;
constexpr std::size_t kMostEventBytes = 512;

}  // namespace

// Names come from the code, not from users: nothing needs to be escaped.
class Timeline::Impl {
 public:
  explicit Impl(storage::AtomicFile file) : file_(std::move(file)) { buffer_.reserve(kBufferBytes + kMostEventBytes); }

  [[nodiscard]] double microseconds(Clock::time_point when) const {
    return std::chrono::duration<double, std::micro>(when - start_).count();
  }

  template <typename... Values>
  void event(const char* format, Values... values) {
    char text[kMostEventBytes];
    const int length = std::snprintf(text, sizeof text, format, values...);
    const std::lock_guard lock(mutex_);
    if (length <= 0 || length >= static_cast<int>(sizeof text) || finished_ || !status_.ok()) {
      return;
    }
    buffer_ += first_ ? "{\"traceEvents\":[\n" : ",\n";
    first_ = false;
    buffer_.append(text, static_cast<std::size_t>(length));
    if (buffer_.size() >= kBufferBytes) {
      flush();
    }
  }

  Status finish() {
    const std::lock_guard lock(mutex_);
    if (!finished_) {
      finished_ = true;
      buffer_ += first_ ? "{\"traceEvents\":[]}\n" : "\n]}\n";
      flush();
      if (status_.ok()) {
        status_ = file_.commit();
      }
    }
    return status_;
  }

 private:
  void flush() {
    if (status_.ok()) {
      status_ = file_.write(std::as_bytes(std::span(buffer_)));
    }
    buffer_.clear();
  }

  const Clock::time_point start_ = Clock::now();
  std::mutex mutex_;
  storage::AtomicFile file_;
  std::string buffer_;
  Status status_;
  bool first_ = true;
  bool finished_ = false;
};

Timeline::Timeline(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Timeline::~Timeline() = default;

Result<std::shared_ptr<Timeline>> Timeline::create(const std::string& path) {
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile file, storage::AtomicFile::create(path));
  return std::shared_ptr<Timeline>(new Timeline(std::make_unique<Impl>(std::move(file))));
}

void Timeline::name_lane(unsigned lane, std::string_view name) {
  impl_->event(R"({"ph":"M","pid":1,"tid":%u,"name":"thread_name","args":{"name":"%.*s"}})", lane,
               static_cast<int>(name.size()), name.data());
}

void Timeline::span(unsigned lane, std::string_view name, Clock::time_point begin, std::string_view unit,
                    std::uint64_t amount) {
  const double from = impl_->microseconds(begin), to = impl_->microseconds(Clock::now());
  impl_->event(R"({"ph":"X","pid":1,"tid":%u,"name":"%.*s","ts":%.3f,"dur":%.3f,"args":{"%.*s":%)" PRIu64 "}}", lane,
               static_cast<int>(name.size()), name.data(), from, to - from, static_cast<int>(unit.size()), unit.data(),
               amount);
}

void Timeline::read(std::uint32_t page, Clock::time_point begin, Clock::time_point end, std::uint64_t bytes) {
  impl_->event(R"({"ph":"b","cat":"read","pid":1,"id":%u,"name":"read","ts":%.3f,"args":{"bytes":%)" PRIu64 "}}", page,
               impl_->microseconds(begin), bytes);
  impl_->event(R"({"ph":"e","cat":"read","pid":1,"id":%u,"name":"read","ts":%.3f})", page, impl_->microseconds(end));
}

void Timeline::counter(std::string_view name, std::uint64_t value) {
  impl_->event(R"({"ph":"C","pid":1,"name":"%.*s","ts":%.3f,"args":{"value":%)" PRIu64 "}}",
               static_cast<int>(name.size()), name.data(), impl_->microseconds(Clock::now()), value);
}

Status Timeline::finish() { return impl_->finish(); }

}  // namespace raymill
