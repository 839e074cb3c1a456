// Belady's optimum: the least reads that a sequence of page requests can be served with in so many frames (Belady 1966:
// the page that is asked for latest goes). Immutable functions.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "storage/base/status.h"

namespace raymill::bench {

/// A page trace (traversal/page_trace.h), read.
struct PageRequests {
  std::uint32_t page_count = 0;
  std::uint32_t frame_count = 0;
  std::uint64_t batches = 0;
  std::uint64_t reads = 0;
  std::uint64_t evictions = 0;
  std::vector<std::uint32_t> pages;  ///< each batch's page, then the others that it entered
};
/// Errors: those of a file that cannot be read; corrupt (not a page trace).
Result<PageRequests> read_page_trace(const std::string& path);

/// Reads of the best schedule that begins with empty frames and may not skip a request. `requests`: less than 2^32.
std::uint64_t belady_reads(std::span<const std::uint32_t> requests, std::uint32_t page_count, std::uint32_t frames);
/// Pages that occur.
std::uint64_t distinct_pages(std::span<const std::uint32_t> requests, std::uint32_t page_count);

}  // namespace raymill::bench
