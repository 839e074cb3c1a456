#include "client/cli/render/picture.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <string_view>
#include <utility>

extern char** environ;  // NOLINT: POSIX declares it nowhere

namespace raymill::client {

namespace {

constexpr std::size_t kMaxMessageBytes = 4096;

std::string program_folder() {
  std::array<char, PATH_MAX> path{};
  const ssize_t length = ::readlink("/proc/self/exe", path.data(), path.size());
  const std::string_view text(path.data(), static_cast<std::size_t>(std::max<ssize_t>(length, 0)));
  return std::string(text.substr(0, text.rfind('/') + 1));
}

// Reads what the child says until it closes the pipe; what goes past the limit is dropped.
std::string read_message(int descriptor) {
  std::string message;
  std::array<char, 512> part{};
  while (true) {
    const ssize_t count = ::read(descriptor, part.data(), part.size());
    if (count == 0 || (count < 0 && errno != EINTR)) {
      break;
    }
    if (count > 0 && message.size() < kMaxMessageBytes) {
      message.append(part.data(), static_cast<std::size_t>(count));
    }
  }
  while (!message.empty() && message.back() == '\n') {
    message.pop_back();
  }
  return message;
}

// Runs the program and waits for it; the answer is its stderr where it failed.
Status run_program(const std::string& program, const std::array<std::string, 3>& words) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) {
    return {ErrorCode::io, std::string("cannot start ") + program + ": " + std::strerror(errno)};
  }
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  std::array<std::string, 4> text = {program, words[0], words[1], words[2]};
  char* arguments[] = {text[0].data(), text[1].data(), text[2].data(), text[3].data(), nullptr};
  pid_t child = 0;
  const int error = ::posix_spawn(&child, program.c_str(), &actions, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  ::close(ends[1]);
  const std::string message = error == 0 ? read_message(ends[0]) : std::strerror(error);
  ::close(ends[0]);
  if (error != 0) {
    return {ErrorCode::io, "cannot start " + program + ": " + message};
  }
  int state = 0;
  while (::waitpid(child, &state, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(state) && WEXITSTATUS(state) == 0) {
    return {};
  }
  return {ErrorCode::io, message.empty() ? program + " failed" : message};
}

}  // namespace

Result<std::string> image_format(const std::string& path) {
  for (const char* format : {"exr", "png"}) {
    if (path.ends_with(std::string(".") + format)) {
      return std::string(format);
    }
  }
  return Status(ErrorCode::invalid_argument, "a picture's name ends in .exr or .png, '" + path + "' does not");
}

Result<std::string> image_writer_program() {
  if (const char* given = std::getenv("RAYMILL_IMAGE_WRITER"); given != nullptr) {
    return ::access(given, X_OK) == 0
               ? Result<std::string>(given)
               : Status(ErrorCode::not_found, std::string("RAYMILL_IMAGE_WRITER names no program: ") + given);
  }
  const std::string folder = program_folder();
  for (const char* place : {"raymill-image", "../libexec/raymill/raymill-image"}) {
    if (::access((folder + place).c_str(), X_OK) == 0) {
      return folder + place;
    }
  }
  return Status(ErrorCode::not_found, "raymill-image, which writes pictures, is neither in " + folder + " nor in " +
                                          folder + "../libexec/raymill; set RAYMILL_IMAGE_WRITER to it");
}

Result<Picture> Picture::create(const std::string& path, Extent extent, std::uint32_t channels, Tone tone) {
  RAYMILL_ASSIGN_OR_RETURN(std::string format, image_format(path));
  RAYMILL_ASSIGN_OR_RETURN(std::string program, image_writer_program());
  RAYMILL_ASSIGN_OR_RETURN(auto image, storage::AtomicFile::create(path));
  RAYMILL_ASSIGN_OR_RETURN(auto raw, storage::AtomicFile::create(path + ".raw"));
  Picture picture(std::move(image), std::move(raw), std::move(format), std::move(program));
  picture.header_ = {.width = extent.width,
                     .height = extent.height,
                     .channels = channels,
                     .tone = tone,
                     .low = std::numeric_limits<float>::infinity(),
                     .high = 0};
  // The header is written again at the end, when the range of distances is known.
  RAYMILL_RETURN_IF_ERROR(picture.raw_.write(std::as_bytes(std::span(&picture.header_, 1))));
  return picture;
}

Status Picture::append(std::span<const float> rows) {
  if (header_.tone == Tone::distance) {
    for (const float value : rows) {
      if (std::isfinite(value)) {
        header_.low = std::min(header_.low, value);
        header_.high = std::max(header_.high, value);
      }
    }
  }
  return raw_.write(std::as_bytes(rows));
}

Status Picture::commit() {
  RAYMILL_RETURN_IF_ERROR(raw_.pwrite(std::as_bytes(std::span(&header_, 1)), 0));
  RAYMILL_RETURN_IF_ERROR(run_program(program_, {raw_.temporary_path(), format_, image_.temporary_path()}));
  return image_.commit();
}

}  // namespace raymill::client
