// Endpoint: the address that a server listens at, checked and claimed before ZeroMQ may bind it.
//
// ZeroMQ replaces an ipc socket file without asking, whoever listens there. So a server first holds PATH.lock (flock)
// and makes sure that nobody answers at PATH; then a socket file that is left is stale. Move-only.
#pragma once

#include <string>

#include "server/file_descriptor.h"
#include "storage/base/status.h"

namespace raymill::server {

class Endpoint {
 public:
  /// Errors: those of check_server_address, invalid_argument (a file is in the way), busy_retry (a server answers
  /// there), io.
  static Result<Endpoint> claim(const std::string& address);
  Endpoint(Endpoint&&) = default;
  Endpoint(const Endpoint&) = delete;
  Endpoint& operator=(const Endpoint&) = delete;
  ~Endpoint();  ///< removes the socket file and the lock

  /// As ZeroMQ wants it.
  [[nodiscard]] const std::string& address() const { return address_; }
  /// After the bind: only this user may connect to a socket file.
  [[nodiscard]] Status restrict_access() const;

 private:
  Endpoint(std::string address, std::string path, FileDescriptor lock)
      : address_(std::move(address)), path_(std::move(path)), lock_(std::move(lock)) {}
  std::string address_;
  std::string path_;  ///< of the socket file; empty for tcp
  FileDescriptor lock_;
};

}  // namespace raymill::server
