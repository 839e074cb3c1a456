#include "client/cli/npy_rows.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "storage/base/file_io.h"

namespace raymill::client {

namespace {

constexpr std::size_t kRowBufferBytes = 64 << 10;
static_assert(kRowBufferBytes >= kMaxNpyHeaderBytes);

Status io_error(const std::string& path, int number) {
  return {number == ENOENT ? ErrorCode::not_found : ErrorCode::io,
          "cannot read " + path + ": " + std::strerror(number)};
}

// Reads up to bytes.size() at `offset`; fewer only at the end of the file.
Result<std::size_t> read_at(const std::string& path, int descriptor, std::uint64_t offset, std::span<std::byte> bytes) {
  const auto got = storage::read_fully(descriptor, bytes, offset);
  return got ? Result<std::size_t>(*got) : Result<std::size_t>(io_error(path, errno));
}

}  // namespace

NpyRows::NpyRows(NpyRows&& other) noexcept { *this = std::move(other); }

NpyRows& NpyRows::operator=(NpyRows&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(what_, other.what_);
  std::swap(descriptor_, other.descriptor_);
  std::swap(header_, other.header_);
  std::swap(buffer_, other.buffer_);
  file_bytes_ = other.file_bytes_;
  row_bytes_ = other.row_bytes_;
  next_ = other.next_;
  return *this;
}

NpyRows::~NpyRows() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}

Result<NpyRows> NpyRows::open(const std::string& path, const std::string& what) {
  NpyRows file;
  file.path_ = path;
  file.what_ = what;
  // O_NONBLOCK: a pipe without a writer is refused below instead of waited for.
  file.descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat stat {};
  if (file.descriptor_ < 0 || ::fstat(file.descriptor_, &stat) != 0) {
    return io_error(path, errno);
  }
  if (!S_ISREG(stat.st_mode)) {
    return file.bad(what + " are read from plain files only; this is a folder, a pipe or a device");
  }
  file.file_bytes_ = static_cast<std::uint64_t>(stat.st_size);
  file.buffer_.resize(kRowBufferBytes);
  RAYMILL_ASSIGN_OR_RETURN(const std::size_t begin_bytes, read_at(path, file.descriptor_, 0, file.buffer_));
  auto parsed = parse_npy_header(std::span(file.buffer_).first(begin_bytes));
  if (!parsed) {
    return file.bad(parsed.status().message());
  }
  file.header_ = std::move(*parsed);
  if (file.header_.fortran_order) {
    return file.bad(what + " are stored row by row (C order), this file is in Fortran order");
  }
  return file;
}

std::string NpyRows::shape_text() const {
  std::string text = "(";
  for (std::size_t i = 0; i < header_.shape.size(); ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(header_.shape[i]);
  }
  return text + (header_.shape.size() == 1 ? ",)" : ")");
}

Status NpyRows::begin(std::size_t row_bytes) {
  row_bytes_ = row_bytes;
  const std::uint64_t data_bytes = file_bytes_ - std::min<std::uint64_t>(file_bytes_, header_.data_offset);
  if (data_bytes / row_bytes != count() || data_bytes % row_bytes != 0) {
    return bad("its header promises " + std::to_string(count()) + " " + what_ + " of " + std::to_string(row_bytes) +
               " bytes, " + std::to_string(data_bytes) + " bytes follow");
  }
  (void)::posix_fadvise(descriptor_, 0, 0, POSIX_FADV_SEQUENTIAL);
  return {};
}

std::string NpyRows::identity() const {
  struct stat info {};
  ::fstat(descriptor_, &info);
  return std::to_string(info.st_size) + " bytes of " + std::to_string(info.st_mtim.tv_sec) + "." +
         std::to_string(info.st_mtim.tv_nsec);
}

Result<std::span<const std::byte>> NpyRows::read(std::size_t rows) {
  const std::uint64_t step = std::min<std::uint64_t>({rows, count() - next_, buffer_.size() / row_bytes_});
  const auto raw = std::span(buffer_).first(step * row_bytes_);
  RAYMILL_ASSIGN_OR_RETURN(const std::size_t got,
                           read_at(path_, descriptor_, header_.data_offset + next_ * row_bytes_, raw));
  if (got < raw.size()) {
    return bad("the file became shorter while it was read");
  }
  next_ += step;
  return std::span<const std::byte>(raw);
}

}  // namespace raymill::client
