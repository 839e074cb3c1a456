#include "storage/base/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>

namespace raymill::storage {

namespace {

// Longest part of the target's name that goes into the temporary's, so that names of any legal length work.
constexpr std::size_t kMaxNameInTemporary = 200;
constexpr int kMaxAttempts = 1000;

Status error(const char* what, const std::string& path, int number) {
  ErrorCode code = ErrorCode::io;
  if (number == ENOSPC || number == EDQUOT) {
    code = ErrorCode::disk_full;
  } else if (number == ENOENT || number == ENOTDIR) {
    code = ErrorCode::not_found;
  }
  return {code, std::string("cannot ") + what + " " + path + ": " + std::strerror(number)};
}

std::string follow_link(const std::string& path) {
  const std::unique_ptr<char, void (*)(void*)> real(::realpath(path.c_str(), nullptr), &std::free);
  return real ? std::string(real.get()) : path;
}

std::string temporary_name(const std::string& target) {
  static std::atomic<unsigned> counter{0};
  const std::size_t slash = target.rfind('/');
  const std::size_t name_begin = slash == std::string::npos ? 0 : slash + 1;
  return target.substr(0, name_begin) + target.substr(name_begin, kMaxNameInTemporary) + "." +
         std::to_string(::getpid()) + "-" + std::to_string(counter++) + ".tmp";
}

}  // namespace

Result<AtomicFile> AtomicFile::create(const std::string& path) {
  AtomicFile file;
  struct stat target {};
  const bool exists = ::stat(path.c_str(), &target) == 0;
  if (path.empty() || (exists && S_ISDIR(target.st_mode))) {
    return Status(ErrorCode::invalid_argument, "cannot write '" + path + "': it does not name a file");
  }
  file.path_ = exists ? follow_link(path) : path;
  if (exists && !S_ISREG(target.st_mode)) {
    file.path_ = path;
    file.temporary_path_ = path;
    file.descriptor_ = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
    return file.descriptor_ >= 0 ? Result<AtomicFile>(std::move(file)) : error("write", path, errno);
  }
  // A name may be taken: by another machine on the same share, or left by a killed process that had our id.
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    file.temporary_path_ = temporary_name(file.path_);
    file.descriptor_ = ::open(file.temporary_path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file.descriptor_ >= 0) {
      return file;
    }
    if (errno != EEXIST) {
      break;
    }
  }
  return error("write", path, errno);
}

AtomicFile::~AtomicFile() {
  if (descriptor_ < 0) {
    return;
  }
  ::close(descriptor_);
  if (temporary_path_ != path_) {
    ::unlink(temporary_path_.c_str());
  }
}

Status AtomicFile::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t count = ::write(descriptor_, bytes.data(), bytes.size());
    if (count < 0) {
      if (errno == EINTR) {
        continue;
      }
      return error("write", path_, errno);
    }
    written_bytes_ += static_cast<std::uint64_t>(count);
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
  return {};
}

Status AtomicFile::pwrite(std::span<const std::byte> bytes, std::uint64_t offset) {
  while (!bytes.empty()) {
    const ssize_t count = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (count < 0) {
      if (errno == EINTR) {
        continue;
      }
      return error("write", path_, errno);
    }
    offset += static_cast<std::uint64_t>(count);
    bytes = bytes.subspan(static_cast<std::size_t>(count));
  }
  return {};
}

Status AtomicFile::commit() {
  // Some file systems report a full disk only here. Linux closes the descriptor whatever close() answers.
  const int closed = ::close(std::exchange(descriptor_, -1));
  const int close_errno = errno;
  if (temporary_path_ == path_) {
    return closed == 0 ? Status() : error("write", path_, close_errno);
  }
  if (closed == 0 && std::rename(temporary_path_.c_str(), path_.c_str()) == 0) {
    return {};
  }
  const int number = closed == 0 ? errno : close_errno;
  ::unlink(temporary_path_.c_str());
  return error("write", path_, number);
}

}  // namespace raymill::storage
