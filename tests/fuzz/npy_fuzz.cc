// The header of a ray file, from any bytes: parsed or refused, never trusted.

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>

#include "client/cli/npy.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto header = raymill::client::parse_npy_header(std::as_bytes(std::span(data, size)));
  if (header && (header->data_offset > size || header->shape.size() > raymill::client::kMaxNpyDimensions)) {
    std::abort();
  }
  return 0;
}
