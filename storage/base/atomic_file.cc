#include "storage/base/atomic_file.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <string_view>

#include "storage/base/file_io.h"

namespace raymill::storage {

namespace {

// Longest part of the target's name that goes into the temporary's, so that names of any legal length work.
constexpr std::size_t kMaxNameInTemporary = 200;
constexpr int kMaxAttempts = 1000;

Status error(const char* what, const std::string& path, int number) {
  const ErrorCode code = number == ENOENT || number == ENOTDIR ? ErrorCode::not_found : write_error(number);
  return {code, std::string("cannot ") + what + " " + path + ": " + std::strerror(number)};
}

std::string follow_link(const std::string& path) {
  const std::unique_ptr<char, void (*)(void*)> real(::realpath(path.c_str(), nullptr), &std::free);
  return real ? std::string(real.get()) : path;
}

std::size_t name_begin(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? 0 : slash + 1;
}

// What the names of all temporaries of a target begin with: "NAME.".
std::string temporary_prefix(const std::string& target) {
  return target.substr(name_begin(target), kMaxNameInTemporary) + ".";
}

std::string temporary_name(const std::string& target) {
  static std::atomic<unsigned> counter{0};
  return target.substr(0, name_begin(target)) + temporary_prefix(target) + std::to_string(::getpid()) + "-" +
         std::to_string(counter++) + ".tmp";
}

// NAME.PID-N.tmp, as temporary_name() makes it.
bool is_temporary(std::string_view name, std::string_view prefix) {
  const auto skip_number = [&name] {
    const std::size_t digits = std::min(name.find_first_not_of("0123456789"), name.size());
    name.remove_prefix(digits);
    return digits > 0;
  };
  const auto skip = [&name](std::string_view text) {
    const bool there = name.substr(0, text.size()) == text;
    name.remove_prefix(there ? text.size() : 0);
    return there;
  };
  return skip(prefix) && skip_number() && skip("-") && skip_number() && name == ".tmp";
}

enum class Lock : std::uint8_t { taken, held_by_another, impossible };

Lock lock(int descriptor) {
  if (::flock(descriptor, LOCK_EX | LOCK_NB) == 0) {
    return Lock::taken;
  }
  return errno == EWOULDBLOCK ? Lock::held_by_another : Lock::impossible;
}

// Whoever removes a temporary that is not its own holds its lock; so between the look and the removal the name cannot
// come to mean another file.
void remove_if_abandoned(int folder, const char* name) {
  const int file = ::openat(folder, name, O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (file < 0) {
    return;
  }
  struct stat opened {
  }, named{};
  if (::fstat(file, &opened) == 0 && S_ISREG(opened.st_mode) && lock(file) == Lock::taken &&
      ::fstatat(folder, name, &named, AT_SYMLINK_NOFOLLOW) == 0 && named.st_ino == opened.st_ino &&
      named.st_dev == opened.st_dev) {
    ::unlinkat(folder, name, 0);
  }
  ::close(file);
}

void remove_abandoned(const std::string& target) {
  const std::string folder = target.substr(0, name_begin(target));
  const std::unique_ptr<DIR, int (*)(DIR*)> entries(::opendir(folder.empty() ? "." : folder.c_str()), &::closedir);
  if (!entries) {
    return;
  }
  const std::string prefix = temporary_prefix(target);
  while (const dirent* entry = ::readdir(entries.get())) {
    if (is_temporary(entry->d_name, prefix)) {
      remove_if_abandoned(::dirfd(entries.get()), entry->d_name);
    }
  }
}

// Whether the temporary that was just made is ours: another process may have taken it for abandoned before it was
// locked.
bool keep(int descriptor) {
  struct stat made {};
  const Lock locked = lock(descriptor);
  return locked == Lock::impossible || (locked == Lock::taken && ::fstat(descriptor, &made) == 0 && made.st_nlink > 0);
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
  remove_abandoned(file.path_);
  // A name may be taken: by another machine on the same share, or left by a killed process that had our id.
  for (int attempt = 0; attempt < kMaxAttempts; ++attempt) {
    file.temporary_path_ = temporary_name(file.path_);
    file.descriptor_ = ::open(file.temporary_path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file.descriptor_ >= 0 && keep(file.descriptor_)) {
      return file;
    }
    if (file.descriptor_ >= 0) {
      ::close(std::exchange(file.descriptor_, -1));
    } else if (errno != EEXIST) {
      break;
    }
  }
  return error("write", path, errno);
}

AtomicFile::~AtomicFile() {
  if (descriptor_ < 0) {
    return;
  }
  if (temporary_path_ != path_) {
    ::unlink(temporary_path_.c_str());
  }
  ::close(descriptor_);
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
  return write_fully(descriptor_, bytes, offset) ? Status() : error("write", path_, errno);
}

Status AtomicFile::commit() {
  // A second descriptor keeps the lock until the file has its name.
  const int still_locked = ::fcntl(descriptor_, F_DUPFD_CLOEXEC, 0);
  const Status status = close_and_rename();
  if (still_locked >= 0) {
    ::close(still_locked);
  }
  return status;
}

Status AtomicFile::close_and_rename() {
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
