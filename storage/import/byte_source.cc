#include "storage/import/byte_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <system_error>

#include "storage/base/file_io.h"
#include "storage/import/message.h"

namespace raymill::storage {

namespace {

std::string reason(int error) { return std::generic_category().message(error); }

}  // namespace

Result<ByteSource> ByteSource::open(const std::string& path) {
  ByteSource source;
  // O_NONBLOCK: a pipe in the file's place must not hold the import up.
  source.descriptor_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (source.descriptor_ < 0) {
    const int error = errno;
    if (error == ENOENT || error == ENOTDIR) {
      return Status(ErrorCode::not_found, message("there is no file ", path));
    }
    return Status(ErrorCode::io, message("cannot open ", path, " (", reason(error), ")"));
  }
  struct stat info {};
  if (::fstat(source.descriptor_, &info) != 0) {
    return Status(ErrorCode::io, message("cannot read the size of ", path, " (", reason(errno), ")"));
  }
  if (!S_ISREG(info.st_mode)) {
    return bad_scene(path, " is not a regular file");
  }
  source.size_bytes_ = static_cast<std::uint64_t>(info.st_size);
  return source;
}

ByteSource ByteSource::view(std::span<const std::byte> bytes) {
  ByteSource source;
  source.bytes_ = bytes;
  source.size_bytes_ = bytes.size();
  return source;
}

ByteSource::~ByteSource() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}

Status ByteSource::read(std::uint64_t offset, std::span<std::byte> out) const {
  if (offset > size_bytes_ || out.size() > size_bytes_ - offset) {
    return bad_scene("bytes ", offset, "..", offset + out.size(), " lie past the end at byte ", size_bytes_);
  }
  if (descriptor_ < 0) {
    if (!out.empty()) {
      std::memcpy(out.data(), bytes_.data() + offset, out.size());
    }
    return {};
  }
  const auto got = read_fully(descriptor_, out, offset);
  if (!got) {
    return {ErrorCode::io, message("cannot read at byte ", offset, " (", reason(errno), ")")};
  }
  if (*got < out.size()) {
    return {ErrorCode::io,
            message("the file ended at byte ", offset + *got, " while it was read; it was changed meanwhile")};
  }
  return {};
}

}  // namespace raymill::storage
