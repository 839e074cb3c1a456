#include "server/spool.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "server/wire.h"
#include "storage/base/file_io.h"

namespace raymill::server {

namespace {

namespace fs = std::filesystem;

constexpr std::string_view kFolderPrefix = "raymill-spool-";
constexpr std::string_view kLockName = "lock";
constexpr std::string_view kRowsSuffix = ".rows";
constexpr std::string_view kPartSuffix = ".rows.part";

Status system_error(const std::string& what, int error) {
  return {storage::write_error(error), what + ": " + std::generic_category().message(error)};
}

std::string rows_path(const std::string& folder, const std::string& job) {
  return folder + "/" + job + std::string(kRowsSuffix);
}

bool is_spool_file(std::string_view name) {
  if (name == kLockName) {
    return true;
  }
  for (const std::string_view suffix : {kRowsSuffix, kPartSuffix}) {
    if (name.ends_with(suffix) && is_job_id(name.substr(0, name.size() - suffix.size()))) {
      return true;
    }
  }
  return false;
}

/// Removes the files of ours in a spool folder, and the folder where nothing else is in it.
void remove_folder(const fs::path& folder) {
  std::error_code ignored;
  for (fs::directory_iterator it(folder, ignored), end; !ignored && it != end; it.increment(ignored)) {
    std::error_code error;
    if (is_spool_file(it->path().filename().string()) && fs::is_regular_file(it->symlink_status(error))) {
      fs::remove(it->path(), error);
    }
  }
  fs::remove(folder, ignored);
}

FileDescriptor try_lock(const fs::path& path, int flags) {
  FileDescriptor file(::open(path.c_str(), flags | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0600));
  if (file.valid() && ::flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
    return {};
  }
  return file;
}

void clear_stale(const fs::path& directory) {
  std::error_code error;
  for (fs::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    std::error_code ignored;
    if (!name.starts_with(kFolderPrefix) || !is_job_id(name.substr(kFolderPrefix.size())) ||
        !fs::is_directory(it->symlink_status(ignored))) {
      continue;
    }
    if (const FileDescriptor lock = try_lock(it->path() / kLockName, 0); lock.valid()) {
      remove_folder(it->path());
    }
  }
}

}  // namespace

SpoolWriter::~SpoolWriter() {
  if (file_.valid()) {
    ::unlink((path_ + ".part").c_str());
  }
}

Status SpoolWriter::append(std::span<const std::byte> rows) {
  while (!rows.empty()) {
    const ::ssize_t written = ::write(file_.get(), rows.data(), rows.size());
    if (written < 0 && errno == EINTR) {
      continue;
    }
    if (written <= 0) {
      return system_error("rows of a submitted job cannot be written to " + path_, written == 0 ? ENOSPC : errno);
    }
    rows = rows.subspan(static_cast<std::size_t>(written));
  }
  return {};
}

Status SpoolWriter::commit() {
  if (::rename((path_ + ".part").c_str(), path_.c_str()) != 0) {
    return system_error("rows of a submitted job cannot be kept as " + path_, errno);
  }
  file_ = FileDescriptor();
  return {};
}

Result<std::unique_ptr<Spool>> Spool::create(const std::string& directory, const std::string& instance) {
  const char* temporary = std::getenv("TMPDIR");
  const fs::path base = !directory.empty()                        ? fs::path(directory)
                        : temporary != nullptr && *temporary != 0 ? fs::path(temporary)
                                                                  : fs::path("/tmp");
  std::error_code error;
  fs::create_directories(base, error);
  if (error) {
    return system_error("the spool directory " + base.string() + " cannot be made", error.value());
  }
  clear_stale(base);
  const fs::path folder = base / (std::string(kFolderPrefix) + instance);
  if (::mkdir(folder.c_str(), 0700) != 0) {
    return system_error("the spool folder " + folder.string() + " cannot be made", errno);
  }
  FileDescriptor lock = try_lock(folder / kLockName, O_CREAT);
  if (!lock.valid()) {
    return system_error("the spool folder " + folder.string() + " cannot be locked", errno);
  }
  return std::unique_ptr<Spool>(new Spool(folder.string(), std::move(lock)));
}

Spool::~Spool() { remove_folder(folder_); }

Result<SpoolWriter> Spool::write(const std::string& job) const {
  std::string path = rows_path(folder_, job);
  FileDescriptor file(::open((path + ".part").c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!file.valid()) {
    return system_error("rows of a submitted job cannot be written to " + path, errno);
  }
  return SpoolWriter(std::move(file), std::move(path));
}

Status Spool::read(const std::string& job, std::uint64_t offset, std::span<std::byte> bytes) const {
  const std::string path = rows_path(folder_, job);
  const FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!file.valid()) {
    return system_error("kept rows cannot be read from " + path, errno);
  }
  const auto got = storage::read_fully(file.get(), bytes, offset);
  if (!got) {
    return system_error("kept rows cannot be read from " + path, errno);
  }
  if (*got < bytes.size()) {
    return {ErrorCode::corrupt, "kept rows in " + path + " end before their time"};
  }
  return {};
}

void Spool::remove(const std::string& job) const { ::unlink(rows_path(folder_, job).c_str()); }

}  // namespace raymill::server
