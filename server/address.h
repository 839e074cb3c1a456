// Addresses: what a server may listen at and a client connect to. Thread-safe functions.
#pragma once

#include <string>
#include <string_view>

#include "storage/base/status.h"

namespace raymill::server {

/// Takes ipc://PATH, or tcp://HOST:PORT of the loopback interface (PORT 0 or *: any free one); answers it as ZeroMQ
/// wants it. Errors: invalid_argument (no such address), unsupported (reachable from other machines: needs CURVE).
Result<std::string> check_server_address(const std::string& address);

/// Takes ipc://PATH or tcp://HOST:PORT. Errors: invalid_argument.
Status check_client_address(const std::string& address);

/// The path of an ipc address; empty for another one.
std::string_view ipc_path(std::string_view address);

}  // namespace raymill::server
