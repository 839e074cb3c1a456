// XXH3, 64 bits: the checksum of everything that goes to disk or to the wire. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace raymill::storage {

std::uint64_t checksum(std::span<const std::byte> bytes);

}  // namespace raymill::storage
