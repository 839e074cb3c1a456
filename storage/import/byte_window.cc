#include "storage/import/byte_window.h"

#include <algorithm>
#include <cstring>

namespace raymill::storage {

bool ByteWindow::skip(std::uint64_t count) {
  const std::uint64_t held = end_ - begin_;
  if (count <= held) {
    begin_ += count;
    return true;
  }
  if (count - held > file_->size_bytes() - std::min(file_->size_bytes(), read_to_)) {
    return false;
  }
  read_to_ += count - held;
  begin_ = end_ = 0;
  return true;
}

void ByteWindow::refill(std::size_t least) {
  std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
  end_ -= begin_;
  begin_ = 0;
  while (end_ < least && status_.ok() && read_to_ < file_->size_bytes()) {
    const std::uint64_t wanted = std::min<std::uint64_t>(kBytes - end_, file_->size_bytes() - read_to_);
    status_ = file_->read(read_to_, std::span(buffer_).subspan(end_, wanted));
    if (status_.ok()) {
      end_ += wanted;
      read_to_ += wanted;
    }
  }
}

}  // namespace raymill::storage
