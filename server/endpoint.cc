#include "server/endpoint.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string_view>
#include <system_error>
#include <utility>

#include "server/address.h"

namespace raymill::server {

namespace {

std::string error_text(int error) { return std::generic_category().message(error); }

/// Holds PATH.lock. The file may have been removed by the server before, between open and flock: then once more.
Result<FileDescriptor> lock_path(const std::string& lock_path) {
  for (int attempt = 0; attempt < 16; ++attempt) {
    FileDescriptor file(::open(lock_path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
    if (!file.valid()) {
      return {ErrorCode::io, "cannot make " + lock_path + ": " + error_text(errno)};
    }
    if (::flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
      break;
    }
    struct stat held {};
    struct stat named {};
    if (::fstat(file.get(), &held) == 0 && ::stat(lock_path.c_str(), &named) == 0 && held.st_ino == named.st_ino &&
        held.st_dev == named.st_dev) {
      return file;
    }
  }
  return {ErrorCode::busy_retry, "another server holds " + lock_path + "; stop it or bind elsewhere"};
}

/// Whether anybody accepts connections at a socket file.
bool somebody_listens(const std::string& path) {
  const FileDescriptor probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  ::sockaddr_un name{};
  name.sun_family = AF_UNIX;
  std::memcpy(name.sun_path, path.data(), path.size());
  if (::connect(probe.get(), reinterpret_cast<const ::sockaddr*>(&name), sizeof name) == 0) {
    return true;
  }
  return errno == EAGAIN;  // its queue of connections is full
}

}  // namespace

Result<Endpoint> Endpoint::claim(const std::string& address) {
  RAYMILL_ASSIGN_OR_RETURN(std::string checked, check_server_address(address));
  const std::string path(ipc_path(checked));
  if (path.empty()) {
    return Endpoint(std::move(checked), "", {});
  }
  RAYMILL_ASSIGN_OR_RETURN(FileDescriptor lock, lock_path(path + ".lock"));
  struct stat present {};
  if (::lstat(path.c_str(), &present) == 0) {
    if (!S_ISSOCK(present.st_mode)) {
      return {ErrorCode::invalid_argument, path + " is there and is no socket; bind elsewhere or remove it"};
    }
    if (somebody_listens(path)) {
      return {ErrorCode::busy_retry, "something answers at " + address + "; stop it or bind elsewhere"};
    }
    if (::unlink(path.c_str()) != 0) {
      return {ErrorCode::io, "the stale socket " + path + " cannot be removed: " + error_text(errno)};
    }
  }
  return Endpoint(std::move(checked), path, std::move(lock));
}

Endpoint::~Endpoint() {
  if (lock_.valid()) {
    ::unlink(path_.c_str());
    ::unlink((path_ + ".lock").c_str());
  }
}

Status Endpoint::restrict_access() const {
  if (!path_.empty() && ::chmod(path_.c_str(), 0600) != 0) {
    return {ErrorCode::io, "cannot restrict access to " + path_ + ": " + error_text(errno)};
  }
  return {};
}

}  // namespace raymill::server
