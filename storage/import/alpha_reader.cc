#include "storage/import/alpha_reader.h"

#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <span>
#include <string_view>
#include <utility>

#include "storage/import/alpha_stream.h"
#include "storage/import/message.h"

namespace raymill::storage {
namespace {

// What the child said where it failed, else that its stream was cut.
Status end_of_alpha(ChildStream& stream) {
  const Status status = stream.finish();
  return status.ok() ? bad_scene("the stream of its texels ends early")
                     : Status(status.code(), message("cannot be read as a picture (", status.message(), ")"));
}

// Whether each value counts, for rows of one bit a texel.
std::vector<bool> counting(const MaskInfo& info, std::uint32_t most) {
  const std::uint32_t least = least_counting(most, info.factor, 1, info.cutoff);
  std::vector<bool> out(std::size_t{most} + 1);
  for (std::uint32_t value = least; value <= most; ++value) {
    out[value] = true;
  }
  return out;
}

std::uint32_t alpha_at(std::span<const std::byte> row, std::uint32_t x, std::uint32_t value_bytes) {
  const auto low = static_cast<std::uint32_t>(row[std::size_t{x} * value_bytes]);
  return value_bytes == 1 ? low : low | static_cast<std::uint32_t>(row[std::size_t{x} * 2 + 1]) << 8;
}

}  // namespace

Result<std::string> image_reader_program() {
  if (const char* given = std::getenv("RAYMILL_IMAGE_READER"); given != nullptr) {
    return ::access(given, X_OK) == 0
               ? Result<std::string>(given)
               : Status(ErrorCode::not_found, std::string("RAYMILL_IMAGE_READER names no program: ") + given);
  }
  std::array<char, PATH_MAX> path{};
  const ssize_t length = ::readlink("/proc/self/exe", path.data(), path.size());
  const std::string_view text(path.data(), length > 0 ? static_cast<std::size_t>(length) : 0);
  const std::string folder(text.substr(0, text.rfind('/') + 1));
  for (const char* place : {"raymill-image", "../libexec/raymill/raymill-image"}) {
    if (::access((folder + place).c_str(), X_OK) == 0) {
      return folder + place;
    }
  }
  return Status(ErrorCode::not_found, "raymill-image, which reads textures, is neither in " + folder + " nor in " +
                                          folder + "../libexec/raymill; set RAYMILL_IMAGE_READER to it");
}

Result<PictureFile> PictureFile::create(std::uint64_t size_bytes) {
  const int descriptor = ::memfd_create("picture", MFD_CLOEXEC);
  if (descriptor < 0) {
    return Status(ErrorCode::io, message("cannot hold a picture of ", size_bytes, " bytes: ", std::strerror(errno)));
  }
  return PictureFile(descriptor);
}
PictureFile::PictureFile(PictureFile&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
PictureFile::~PictureFile() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
  }
}
Status PictureFile::write(std::span<const std::byte> bytes) {
  while (!bytes.empty()) {
    const ssize_t done = ::write(descriptor_, bytes.data(), bytes.size());
    if (done < 0 && errno == EINTR) {
      continue;
    }
    if (done <= 0) {
      return {ErrorCode::io, message("cannot hold a picture: ", std::strerror(errno))};
    }
    bytes = bytes.subspan(static_cast<std::size_t>(done));
  }
  return {};
}
std::string PictureFile::path() const { return message("/proc/", ::getpid(), "/fd/", descriptor_); }

Result<std::optional<HeldMask>> read_alpha(const std::string& path, const MaskInfo& like, bool as_values,
                                           Ledger& ledger) {
  RAYMILL_ASSIGN_OR_RETURN(const std::string program, image_reader_program());
  RAYMILL_ASSIGN_OR_RETURN(ChildStream stream, ChildStream::start({program, "alpha", path}));
  AlphaStreamHead head;
  if (!stream.read(std::as_writable_bytes(std::span(&head, 1))) || head.magic != kAlphaStreamMagic ||
      head.value_bytes > 2) {
    return end_of_alpha(stream);
  }
  if (head.value_bytes == 0) {
    return stream.finish().ok() ? Result<std::optional<HeldMask>>(std::nullopt) : end_of_alpha(stream);
  }
  if (head.width - 1 >= kMostMaskEdge || head.height - 1 >= kMostMaskEdge) {
    return Status(ErrorCode::unsupported, message("has ", head.width, " x ", head.height, " texels; up to ",
                                                  kMostMaskEdge, " along an edge are read"));
  }
  const std::uint32_t most = head.value_bytes == 1 ? 255 : 65535;
  HeldMask held;
  AlphaMap& map = held.map;
  map.info = like;
  map.info.width = head.width;
  map.info.height = head.height;
  map.info.bits = static_cast<std::uint8_t>(as_values ? 8 * head.value_bytes : 1);
  map.row_bytes = AlphaMap::bytes_of_row(head.width, map.info.bits);
  const std::uint64_t bytes = std::uint64_t{map.row_bytes} * head.height;
  Result<BudgetReservation> claim = ledger.claim(Tag::build, bytes);
  if (!claim.ok()) {
    return in_context(message("its ", head.width, " x ", head.height, " texels must be held in memory"),
                      claim.status());
  }
  held.claim = std::move(*claim);
  map.texels.resize(bytes);
  const std::vector<bool> counts_here = as_values ? std::vector<bool>() : counting(map.info, most);
  std::vector<std::byte> row(std::size_t{head.width} * head.value_bytes);
  for (std::uint32_t y = 0; y < head.height; ++y) {
    if (!stream.read(row)) {
      return end_of_alpha(stream);
    }
    std::byte* to = map.texels.data() + y * map.row_bytes;
    if (as_values) {
      std::memcpy(to, row.data(), row.size());
      continue;
    }
    for (std::uint32_t x = 0; x < head.width; ++x) {
      to[x / 8] |= static_cast<std::byte>(counts_here[alpha_at(row, x, head.value_bytes)] ? 1U << (x % 8) : 0U);
    }
  }
  RAYMILL_RETURN_IF_ERROR(stream.finish().ok() ? Status() : end_of_alpha(stream));
  return std::optional<HeldMask>(std::move(held));
}

}  // namespace raymill::storage
