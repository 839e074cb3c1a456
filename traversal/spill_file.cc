#include "traversal/spill_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <utility>

#include "storage/base/file_io.h"

namespace raymill::traversal {

SpillFile::SpillFile(Config config) : config_(std::move(config)), free_(words(config_.remembered_places)) {
  assert(!config_.direct || config_.place_bytes % kAlignment == 0);
}

SpillFile::~SpillFile() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}

std::uint32_t SpillFile::take() {
  const std::size_t used_words = std::min<std::size_t>(words(places_), free_.size());
  while (first_word_ < used_words && free_[first_word_] == 0) {
    ++first_word_;
  }
  if (first_word_ >= used_words) {
    return places_++;
  }
  const auto bit = static_cast<std::uint32_t>(std::countr_zero(free_[first_word_]));
  free_[first_word_] &= free_[first_word_] - 1;
  return static_cast<std::uint32_t>(first_word_ * 64) + bit;
}

void SpillFile::give(std::uint32_t place) {
  if (const std::size_t word = place / 64; word < free_.size()) {
    free_[word] |= std::uint64_t(1) << place % 64;
    first_word_ = std::min(first_word_, word);
  } else {
    // Where the file system cannot, the space comes back when the file goes.
    (void)::fallocate(descriptor_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
                      static_cast<off_t>(place * config_.place_bytes), static_cast<off_t>(config_.place_bytes));
  }
}

Status SpillFile::open() {
  const std::lock_guard lock(opening_);
  if (descriptor_ >= 0) {
    return {};
  }
  const int descriptor = storage::open_nameless(config_.directory);
  if (descriptor < 0) {
    return {ErrorCode::io, "cannot make a temporary file for " + config_.what + " in " + config_.directory + ": " +
                               std::strerror(errno) + "; set TMPDIR to a folder with room"};
  }
  direct_ = config_.direct && ::fcntl(descriptor, F_SETFL, ::fcntl(descriptor, F_GETFL) | O_DIRECT) == 0;
  if (!direct_) {
    ::posix_fadvise(descriptor, 0, 0, POSIX_FADV_RANDOM);  // places come back in another order than they went
  }
  descriptor_ = descriptor;
  return {};
}

std::size_t SpillFile::whole(std::size_t bytes) const {
  return direct_ ? (bytes + kAlignment - 1) / kAlignment * kAlignment : bytes;
}

Status SpillFile::write(std::uint32_t place, std::span<std::byte> bytes) {
  assert(bytes.size() <= config_.place_bytes);
  RAYMILL_RETURN_IF_ERROR(open());
  const std::span<const std::byte> all{bytes.data(), whole(bytes.size())};
  if (!storage::write_fully(descriptor_, all, std::uint64_t(place) * config_.place_bytes)) {
    return {storage::write_error(errno), "cannot keep " + config_.what + " in a temporary file in " +
                                             config_.directory + ": " + std::strerror(errno) +
                                             "; set TMPDIR to a folder with room"};
  }
  return {};
}

Status SpillFile::read(std::uint32_t place, std::span<std::byte> bytes) const {
  const std::span<std::byte> all{bytes.data(), whole(bytes.size())};
  const auto got = storage::read_fully(descriptor_, all, std::uint64_t(place) * config_.place_bytes);
  if (!got || *got < bytes.size()) {
    return {ErrorCode::io, "cannot read " + config_.what + " back from a temporary file in " + config_.directory +
                               ": " + std::strerror(got ? EIO : errno)};
  }
  return {};
}

}  // namespace raymill::traversal
