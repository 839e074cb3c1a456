#include "storage/io/read_buffers.h"

#include <algorithm>
#include <utility>

namespace raymill::storage {

ReadBuffers::ReadBuffers(const StoreFile& file, unsigned count)
    : file_(file),
      buffer_bytes_(file.read_buffer_bytes()),
      memory_(count * buffer_bytes_),
      taken_(count),
      holders_(count) {}

// Free buffers beside each other, as many as a run could need.
unsigned ReadBuffers::free_from(unsigned buffer) const {
  unsigned end = buffer;
  while (end < taken_.size() && !taken_[end] && end - buffer < kMostRunPages) {
    ++end;
  }
  return end - buffer;
}

std::optional<PageRun> ReadBuffers::take(std::vector<PageId>& requests) {
  PageRun run;
  for (unsigned i = 0; i < taken_.size(); ++i) {
    if (const unsigned free = free_from(i); free > run.buffers) {
      run.buffer = i;
      run.buffers = free;
    }
  }
  if (requests.empty() || run.buffers == 0) {
    return std::nullopt;
  }
  run.first = requests.front();
  run.pages = 1;
  run.blocks = file_.blocks_of(run.first);
  while (run.pages < std::min<std::size_t>(requests.size(), kMostRunPages)) {
    const PageId next = requests[run.pages];
    if (index_of(next) != index_of(run.first) + run.pages) {
      break;
    }
    const PageBlocks blocks = file_.blocks_of(next);
    const std::uint64_t bytes = blocks.offset + blocks.bytes - run.blocks.offset;
    if (blocks.offset + blocks.skipped != run.blocks.offset + run.blocks.needed || buffers_for(bytes) > run.buffers) {
      break;
    }
    run.blocks.bytes = bytes;
    run.blocks.needed = blocks.offset + blocks.needed - run.blocks.offset;
    ++run.pages;
  }
  requests.erase(requests.begin(), requests.begin() + run.pages);
  run.buffers = buffers_for(run.blocks.bytes);
  std::fill_n(taken_.begin() + run.buffer, run.buffers, true);
  holders_[run.buffer] = run;
  return run;
}

void ReadBuffers::release(unsigned buffer) {
  PageRun& run = holders_[buffer];
  if (--run.pages == 0) {
    std::fill_n(taken_.begin() + run.buffer, run.buffers, false);
  }
}

std::vector<PageArrival> ReadBuffers::arrivals(const PageRun& run, std::uint64_t bytes_read) {
  std::vector<PageArrival> arrivals(run.pages);
  for (unsigned i = 0; i < run.pages; ++i) {
    PageArrival& arrival = arrivals[i];
    arrival.page = PageId{index_of(run.first) + i};
    arrival.buffer = run.buffer;
    const PageBlocks blocks = file_.blocks_of(arrival.page);
    const std::uint64_t before = blocks.offset - run.blocks.offset;
    const std::span<std::byte> bytes = bytes_of(run).subspan(before, blocks.bytes);
    auto encoded = bytes_read >= before + blocks.needed ? file_.page_in(arrival.page, bytes, bytes_read - before)
                                                        : file_.read_page(arrival.page, bytes);
    if (encoded) {
      arrival.encoded = *encoded;
    } else {
      arrival.status = encoded.status();
    }
  }
  return arrivals;
}

}  // namespace raymill::storage
