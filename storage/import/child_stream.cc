#include "storage/import/child_stream.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <utility>

#include "storage/base/file_io.h"

extern char** environ;  // NOLINT: POSIX declares it nowhere

namespace raymill::storage {
namespace {

constexpr std::size_t kBufferBytes = 256 << 10;
constexpr std::size_t kMostMessageBytes = 1024;

Status cannot_start(const std::string& program, int error) {
  return {ErrorCode::io, "cannot start " + program + ": " + std::strerror(error)};
}

// Signals that this process ignores are not ignored there.
int spawn(std::vector<std::string>& words, int output, int errors, pid_t& child) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, errors, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t defaults;
  sigemptyset(&defaults);
  sigaddset(&defaults, SIGPIPE);
  posix_spawnattr_setsigdefault(&attributes, &defaults);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF);
  std::vector<char*> arguments;
  for (std::string& word : words) {
    arguments.push_back(word.data());
  }
  arguments.push_back(nullptr);
  const int error = ::posix_spawn(&child, arguments[0], &actions, &attributes, arguments.data(), environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return error;
}

}  // namespace

Result<ChildStream> ChildStream::start(std::vector<std::string> words) {
  int ends[2];
  const int errors = ::memfd_create("errors", MFD_CLOEXEC);
  if (errors < 0 || ::pipe2(ends, O_CLOEXEC) != 0) {
    const int error = errno;
    if (errors >= 0) {
      ::close(errors);
    }
    return cannot_start(words.front(), error);
  }
  pid_t child = -1;
  const int error = spawn(words, ends[1], errors, child);
  ::close(ends[1]);
  if (error != 0) {
    ::close(ends[0]);
    ::close(errors);
    return cannot_start(words.front(), error);
  }
  ChildStream stream(child, ends[0], errors);
  stream.buffer_.resize(kBufferBytes);
  return stream;
}

ChildStream::ChildStream(ChildStream&& other) noexcept
    : child_(std::exchange(other.child_, -1)),
      output_(std::exchange(other.output_, -1)),
      errors_(std::exchange(other.errors_, -1)),
      buffer_(std::move(other.buffer_)),
      at_(other.at_),
      end_(other.end_),
      finished_(other.finished_),
      status_(std::move(other.status_)) {}

ChildStream::~ChildStream() {
  if (child_ >= 0) {
    (void)finish();
    ::close(errors_);
  }
}

bool ChildStream::read(std::span<std::byte> out) {
  while (!out.empty()) {
    if (at_ == end_) {
      const ssize_t got = finished_ ? 0 : ::read(output_, buffer_.data(), buffer_.size());
      if (got < 0 && errno == EINTR) {
        continue;
      }
      if (got <= 0) {
        return false;
      }
      at_ = 0;
      end_ = static_cast<std::size_t>(got);
    }
    const std::size_t count = std::min(out.size(), end_ - at_);
    std::memcpy(out.data(), buffer_.data() + at_, count);
    at_ += count;
    out = out.subspan(count);
  }
  return true;
}

// The last line of what it wrote to stderr.
std::string ChildStream::said() const {
  std::string text(kMostMessageBytes, '\0');
  text.resize(read_fully(errors_, std::as_writable_bytes(std::span(text)), 0).value_or(0));
  while (!text.empty() && text.back() == '\n') {
    text.pop_back();
  }
  const std::size_t line = text.rfind('\n');
  return line == std::string::npos ? text : text.substr(line + 1);
}

Status ChildStream::finish() {
  if (finished_) {
    return status_;
  }
  finished_ = true;
  ::close(output_);
  int state = 0;
  while (::waitpid(child_, &state, 0) < 0 && errno == EINTR) {
  }
  if (!WIFEXITED(state) || WEXITSTATUS(state) != 0) {
    std::string text = said();
    if (WIFSIGNALED(state)) {
      text = std::string("its reader was ended by ") + ::strsignal(WTERMSIG(state));
    }
    status_ = {ErrorCode::bad_scene, text.empty() ? "its reader failed without a word" : text};
  }
  return status_;
}

}  // namespace raymill::storage
