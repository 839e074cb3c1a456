#include "server/list_frames.h"

namespace raymill::server {

Result<std::vector<std::uint32_t>> read_offsets(std::span<const std::byte> frame, std::uint64_t rays,
                                                std::uint64_t rows, std::size_t row_bytes) {
  const Status damaged{ErrorCode::corrupt, "the server sent lists whose offsets do not fit their rows"};
  const std::uint64_t words = frame.size() / sizeof(std::uint32_t);
  if (rays == 0 || rays >= words || rows > frame.size() / row_bytes ||
      frame.size() != (rays + 1) * sizeof(std::uint32_t) + rows * row_bytes) {
    return damaged;
  }
  std::vector<std::uint32_t> offsets(rays + 1);
  std::memcpy(offsets.data(), frame.data(), offsets.size() * sizeof(std::uint32_t));
  if (offsets.front() != 0 || offsets.back() != rows || !std::is_sorted(offsets.begin(), offsets.end())) {
    return damaged;
  }
  return offsets;
}

}  // namespace raymill::server
