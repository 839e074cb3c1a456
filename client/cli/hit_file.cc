#include "client/cli/hit_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <utility>

#include "storage/base/file_io.h"

namespace raymill::client {

namespace {

using nlohmann::json;

Status failed(const std::string& path, const char* what) {
  const int error = errno;
  const ErrorCode code = error == ENOENT ? ErrorCode::not_found : storage::write_error(error);
  return {code, path + ": cannot " + what + ": " + std::strerror(error)};
}

// What of `run` differs from the run that the file describes; empty: nothing.
std::string difference(const std::string& path, const json& run) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  const json before = json::parse(text.str(), nullptr, false);
  if (!before.is_object()) {
    return "it does not say which";
  }
  for (const auto& [key, value] : run.items()) {
    if (!before.contains(key) || before.at(key) != value) {
      return "another " + key;
    }
  }
  return "";
}

}  // namespace

HitFile::HitFile(HitFile&& other) noexcept
    : path_(std::move(other.path_)),
      whole_(std::move(other.whole_)),
      part_(std::exchange(other.part_, -1)),
      part_bytes_(other.part_bytes_),
      rows_done_(other.rows_done_) {}

HitFile::~HitFile() {
  if (part_ >= 0) {
    ::close(part_);
  }
}

Result<HitFile> HitFile::create(const std::string& path, const std::string& header) {
  HitFile file(path);
  RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile whole, storage::AtomicFile::create(path));
  file.whole_.emplace(std::move(whole));
  RAYMILL_RETURN_IF_ERROR(file.write(std::as_bytes(std::span(header))));
  return file;
}

Result<HitFile> HitFile::resume(const std::string& path, const std::string& header, std::size_t row_bytes,
                                const json& run) {
  HitFile file(path);
  const std::string part = path + ".part", description = part + ".json";
  if (struct stat info{}; ::stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode)) {
    return {ErrorCode::invalid_argument, path + ": is not a plain file, so no run can be resumed there"};
  }
  const bool exists = ::access(part.c_str(), F_OK) == 0;
  if (exists) {
    if (const std::string other = difference(description, run); !other.empty()) {
      return {ErrorCode::invalid_argument, part + ": belongs to another run (" + other +
                                               "); remove it to begin anew, or repeat the command that made it"};
    }
  } else {
    RAYMILL_ASSIGN_OR_RETURN(storage::AtomicFile text, storage::AtomicFile::create(description));
    const std::string dumped = run.dump(2) + "\n";
    RAYMILL_RETURN_IF_ERROR(text.write(std::as_bytes(std::span(dumped))));
    RAYMILL_RETURN_IF_ERROR(text.commit());
  }
  RAYMILL_RETURN_IF_ERROR(file.open_part(header, row_bytes));
  return file;
}

// Keeps the header and all whole rows of the part; anything else is cut off.
Status HitFile::open_part(const std::string& header, std::size_t row_bytes) {
  const std::string part = path_ + ".part";
  part_ = ::open(part.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
  if (part_ < 0) {
    return failed(part, "open it");
  }
  if (::flock(part_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    return {ErrorCode::busy_retry, part + ": another process goes on with this run; wait for it"};
  }
  struct stat info {};
  if (::fstat(part_, &info) != 0) {
    return failed(part, "read its size");
  }
  const auto size = static_cast<std::uint64_t>(info.st_size);
  std::string found(header.size(), '\0');
  if (size >= header.size() &&
      storage::read_fully(part_, std::as_writable_bytes(std::span(found)), 0) == found.size()) {
    if (found != header) {
      return {ErrorCode::invalid_argument, part + ": is not a part of these hits; remove it to begin anew"};
    }
    rows_done_ = (size - header.size()) / row_bytes;
  }
  part_bytes_ = rows_done_ > 0 ? header.size() + rows_done_ * row_bytes : 0;
  if (::ftruncate(part_, static_cast<off_t>(part_bytes_)) != 0) {
    return failed(part, "cut it to whole rows");
  }
  return part_bytes_ > 0 ? Status() : write(std::as_bytes(std::span(header)));
}

Status HitFile::write(std::span<const std::byte> rows) {
  if (whole_) {
    return whole_->write(rows);
  }
  if (!storage::write_fully(part_, rows, part_bytes_)) {
    return failed(path_ + ".part", "write it");
  }
  part_bytes_ += rows.size();
  return {};
}

Status HitFile::commit() {
  if (whole_) {
    return whole_->commit();
  }
  const std::string part = path_ + ".part";
  if (::fsync(part_) != 0 || std::rename(part.c_str(), path_.c_str()) != 0) {
    return failed(path_, "give the finished hits their name");
  }
  ::unlink((part + ".json").c_str());
  ::close(std::exchange(part_, -1));
  return {};
}

}  // namespace raymill::client
