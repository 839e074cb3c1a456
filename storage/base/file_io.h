// Whole reads and writes at an offset, and files without a name: what read(2) and write(2) leave to their callers.
//
// Interruptions are repeated and short counts gone on with. Errors stay in errno, so that each caller can say what
// failed and what to do. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "storage/base/status.h"

namespace raymill::storage {

/// Fills `out` from `offset`; how many bytes there were, fewer than asked for only at the end of the file. Nothing:
/// errno.
std::optional<std::size_t> read_fully(int descriptor, std::span<std::byte> out, std::uint64_t offset);

/// Writes all of `bytes` at `offset`. False: errno.
[[nodiscard]] bool write_fully(int descriptor, std::span<const std::byte> bytes, std::uint64_t offset);

/// disk_full where errno says that there is no room (or none for this user or process), else io.
ErrorCode write_error(int number);

/// A file in `folder` for reading and writing that no name leads to from the beginning (O_TMPFILE), or where the file
/// system has no such files from at once after. -1: errno.
int open_nameless(const std::string& folder);

}  // namespace raymill::storage
