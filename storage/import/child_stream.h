// ChildStream: the stdout of a program that this process starts, and how it ended. Thread-confined.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill::storage {

class ChildStream {
 public:
  /// `words`: the program's path, then its arguments. Errors: io.
  static Result<ChildStream> start(std::vector<std::string> words);
  ChildStream(ChildStream&& other) noexcept;
  ChildStream& operator=(ChildStream&&) = delete;
  /// Closes the pipe, at which the program ends when it writes, and waits for it.
  ~ChildStream();

  /// Fills `out`; false where the stream ends before.
  bool read(std::span<std::byte> out);
  /// Waits for the program; bytes that were not read are dropped. Errors: bad_scene, with what it wrote to stderr,
  /// where it did not end with 0. Always the same after the first call.
  Status finish();

 private:
  ChildStream(pid_t child, int output, int errors) : child_(child), output_(output), errors_(errors) {}
  [[nodiscard]] std::string said() const;

  pid_t child_ = -1;
  int output_ = -1;
  int errors_ = -1;  // a file in memory, so that a full pipe never holds the program up
  std::vector<std::byte> buffer_;
  std::size_t at_ = 0, end_ = 0;
  bool finished_ = false;
  Status status_;
};

}  // namespace raymill::storage
