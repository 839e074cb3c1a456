// Status and Result: how every fallible call of Raymill answers.
//
// One table of stable codes, grouped by tens, serves the C++ library, the wire protocol and the exit codes of the
// command line. Codes are never renumbered. Immutable values; thread-compatible.
#pragma once

#include <cassert>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace raymill {

enum class ErrorCode : std::uint16_t {
  ok = 0,
  // 10-19: the caller's request.
  invalid_argument = 10,  ///< a value that no store or machine could accept
  not_found = 11,         ///< a file, store or job that is not there
  unsupported = 12,       ///< well-formed, but needs a feature this build lacks
  unauthorised = 13,      ///< the server does not accept this client
  // 20-29: bytes from a disk or a peer.
  corrupt = 20,            ///< structure breaks the format's rules
  checksum_mismatch = 21,  ///< bytes differ from what was written
  version_mismatch = 22,   ///< written by another version of the format or the protocol
  bad_scene = 23,          ///< a scene file that breaks its own specification
  bad_rays = 24,           ///< a ray file of a shape or type that is not accepted
  // 30-39: resources.
  budget_exceeded = 30,  ///< the memory budget cannot be met; the message names the least that can
  io = 31,               ///< the operating system refused a read or a write
  disk_full = 32,        ///< no space left where the output goes
  // 40-49: passing conditions.
  busy_retry = 40,   ///< try again later
  unavailable = 41,  ///< the server does not answer
  cancelled = 42,    ///< stopped on request
  interrupted = 43,  ///< stopped by a signal
  // 50-59: our own.
  internal = 50,  ///< a bug of Raymill
};

/// The code's stable name, as it appears in messages, JSON and the protocol.
std::string_view to_string(ErrorCode code);

/// The process exit code that stands for `code` (0, 2, 33, 42, 75, 130).
int exit_code(ErrorCode code);

/// What happened: a code and one sentence that says what was wrong, where, and what to do.
class [[nodiscard]] Status {
 public:
  Status() = default;
  Status(ErrorCode code, std::string message) : code_(code), message_(std::move(message)) {}

  [[nodiscard]] bool ok() const { return code_ == ErrorCode::ok; }
  [[nodiscard]] ErrorCode code() const { return code_; }
  [[nodiscard]] const std::string& message() const { return message_; }

 private:
  ErrorCode code_ = ErrorCode::ok;
  std::string message_;
};

/// A value, or the Status that says why there is none.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}  // NOLINT(google-explicit-constructor): returns read as values
  Result(Status status) : status_(std::move(status)) { assert(!status_.ok()); }  // NOLINT(google-explicit-constructor)
  Result(ErrorCode code, std::string message) : status_(code, std::move(message)) {}

  [[nodiscard]] bool ok() const { return value_.has_value(); }
  explicit operator bool() const { return ok(); }
  [[nodiscard]] const Status& status() const { return status_; }

  T& value() & {
    assert(ok());
    return *value_;
  }
  const T& value() const& {
    assert(ok());
    return *value_;
  }
  T&& value() && {
    assert(ok());
    return std::move(*value_);
  }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

 private:
  std::optional<T> value_;
  Status status_;
};

}  // namespace raymill

// Leaves the enclosing function with the Status of `expression` unless that is ok.
#define RAYMILL_RETURN_IF_ERROR(expression)                         \
  do {                                                              \
    if (auto raymill_status = (expression); !raymill_status.ok()) { \
      return raymill_status;                                        \
    }                                                               \
  } while (false)

#define RAYMILL_CONCAT_INNER(a, b) a##b
#define RAYMILL_CONCAT(a, b) RAYMILL_CONCAT_INNER(a, b)

// Declares `lhs` from the value of a Result, or leaves the enclosing function with its Status.
#define RAYMILL_ASSIGN_OR_RETURN(lhs, expression)                \
  auto RAYMILL_CONCAT(raymill_result_, __LINE__) = (expression); \
  if (!RAYMILL_CONCAT(raymill_result_, __LINE__).ok()) {         \
    return RAYMILL_CONCAT(raymill_result_, __LINE__).status();   \
  }                                                              \
  lhs = std::move(RAYMILL_CONCAT(raymill_result_, __LINE__)).value()
