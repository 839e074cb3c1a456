// The header of a NumPy .npy file (format 1.0 to 3.0), read and written. Nothing of a read header is trusted: its
// length, its syntax and the product of its shape are bounded before they are used.
// Specification: numpy.lib.format.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill::client {

/// Longest header that is read, preamble included. NumPy itself refuses to parse more than 10 000 characters.
constexpr std::size_t kMaxNpyHeaderBytes = 64 << 10;
constexpr std::size_t kMaxNpyDimensions = 32;

struct NpyHeader {
  std::string descr;  ///< "<f4", or the text of the list of a structured dtype
  bool fortran_order = false;
  std::vector<std::uint64_t> shape;
  std::size_t data_offset = 0;  ///< where the elements begin
};

/// Parses the header at the start of `file`, which holds the file's first kMaxNpyHeaderBytes or all of it.
/// Errors: bad_rays, with what is wrong and no file name.
Result<NpyHeader> parse_npy_header(std::span<const std::byte> file);

/// A header of format 1.0 for `rows` C-ordered rows. `descr` is the value as Python source: "'<f4'" or "[('t', ...)]".
/// `columns` 0 gives the shape (rows,). Its length is a multiple of 64, and at least `least_bytes`, which is one.
std::string npy_header(const std::string& descr, std::uint64_t rows, std::uint64_t columns,
                       std::size_t least_bytes = 0);

}  // namespace raymill::client
