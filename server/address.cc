#include "server/address.h"

#include <sys/un.h>

#include <algorithm>
#include <charconv>
#include <system_error>

#include "storage/base/quotes.h"

namespace raymill::server {

namespace {

constexpr std::string_view kIpc = "ipc://";
constexpr std::string_view kTcp = "tcp://";

struct HostPort {
  std::string_view host;
  std::string_view port;
  bool valid = false;
};

/// "127.0.0.1", "[::1]" or "localhost", and a port.
HostPort split_tcp(std::string_view address) {
  address.remove_prefix(kTcp.size());
  const std::size_t colon = address.rfind(':');
  if (colon == std::string_view::npos || colon == 0) {
    return {};
  }
  HostPort parts{address.substr(0, colon), address.substr(colon + 1)};
  unsigned number = 0;
  const char* const last = parts.port.data() + parts.port.size();
  const auto [end, error] = std::from_chars(parts.port.data(), last, number);
  parts.valid = parts.port == "*" || (error == std::errc() && end == last && number <= 65535);
  return parts;
}

bool is_loopback(std::string_view host) {
  const bool v4 = host.starts_with("127.") &&
                  std::all_of(host.begin(), host.end(), [](char c) { return c == '.' || (c >= '0' && c <= '9'); });
  return v4 || host == "[::1]" || host == "localhost";
}

Status check_ipc_path(std::string_view path) {
  // sun_path holds the terminating zero too.
  constexpr std::size_t kMostPathBytes = sizeof(::sockaddr_un::sun_path) - 1;
  if (path.empty() || path.size() > kMostPathBytes) {
    return {ErrorCode::invalid_argument, "an ipc address is ipc://PATH with a path of 1 to " +
                                             std::to_string(kMostPathBytes) + " bytes, not ipc://" + std::string(path)};
  }
  if (path == "*" || path.front() == '@') {
    return {ErrorCode::invalid_argument, "ipc://" + std::string(path) + " names no socket file; give ipc://PATH"};
  }
  return {};
}

}  // namespace

std::string_view ipc_path(std::string_view address) {
  return address.starts_with(kIpc) ? address.substr(kIpc.size()) : std::string_view();
}

Result<std::string> check_server_address(const std::string& address) {
  if (address.starts_with(kIpc)) {
    RAYMILL_RETURN_IF_ERROR(check_ipc_path(ipc_path(address)));
    return address;
  }
  const HostPort parts = address.starts_with(kTcp) ? split_tcp(address) : HostPort();
  if (!parts.valid) {
    return {ErrorCode::invalid_argument,
            in_quotes(address) + " is no address: give ipc://PATH or tcp://127.0.0.1:PORT"};
  }
  if (!is_loopback(parts.host)) {
    return {ErrorCode::unsupported,
            address +
                " can be reached from other machines, and this server has no CURVE keys to tell who may connect; "
                "bind to loopback (tcp://127.0.0.1:PORT) or to ipc://PATH"};
  }
  const std::string host(parts.host == "localhost" ? "127.0.0.1" : parts.host);
  return std::string(kTcp) + host + ":" + std::string(parts.port == "0" ? "*" : parts.port);
}

Status check_client_address(const std::string& address) {
  if (address.starts_with(kIpc)) {
    return check_ipc_path(ipc_path(address));
  }
  if (address.starts_with(kTcp)) {
    const HostPort parts = split_tcp(address);
    if (parts.valid && parts.port != "*" && parts.port != "0" && parts.host != "*") {
      return {};
    }
  }
  return {ErrorCode::invalid_argument,
          in_quotes(address) + " is no server's address: give ipc://PATH or tcp://HOST:PORT"};
}

}  // namespace raymill::server
