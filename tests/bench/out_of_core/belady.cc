#include "tests/bench/out_of_core/belady.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <queue>

#include "traversal/page_trace.h"

namespace raymill::bench {
namespace {

constexpr std::uint32_t kNever = 0xFFFFFFFFu;
constexpr std::size_t kBufferWords = 1 << 16;

// For each request when its page is asked for again.
std::vector<std::uint32_t> next_uses(std::span<const std::uint32_t> requests, std::uint32_t page_count) {
  std::vector<std::uint32_t> next(requests.size()), seen(page_count, kNever);
  for (std::size_t i = requests.size(); i-- > 0;) {
    next[i] = seen[requests[i]];
    seen[requests[i]] = static_cast<std::uint32_t>(i);
  }
  return next;
}

}  // namespace

std::uint64_t belady_reads(std::span<const std::uint32_t> requests, std::uint32_t page_count, std::uint32_t frames) {
  const std::vector<std::uint32_t> next = next_uses(requests, page_count);
  std::vector<bool> resident(page_count);
  // The residents by their next use, latest first. What a hit leaves behind is in the past, so below every resident: it
  // is never on top, and is thrown out where it piles up.
  using Use = std::pair<std::uint32_t, std::uint32_t>;  // when, page
  std::vector<Use> uses;
  std::uint32_t held = 0;
  std::uint64_t reads = 0;
  for (std::size_t i = 0; i < requests.size(); ++i) {
    const std::uint32_t page = requests[i];
    if (!resident[page]) {
      ++reads;
      if (held == frames) {
        resident[uses.front().second] = false;
        std::pop_heap(uses.begin(), uses.end());
        uses.pop_back();
        --held;
      }
      resident[page] = true;
      ++held;
    }
    uses.emplace_back(next[i], page);
    std::push_heap(uses.begin(), uses.end());
    if (uses.size() > 4 * std::size_t(frames) + 64) {
      std::erase_if(uses, [&](const Use& use) { return use.first <= i; });
      std::make_heap(uses.begin(), uses.end());
    }
  }
  return reads;
}

std::uint64_t distinct_pages(std::span<const std::uint32_t> requests, std::uint32_t page_count) {
  std::vector<bool> seen(page_count);
  for (const std::uint32_t page : requests) {
    seen[page] = true;
  }
  return static_cast<std::uint64_t>(std::count(seen.begin(), seen.end(), true));
}

Result<PageRequests> read_page_trace(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return {ErrorCode::not_found, path + ": cannot be opened"};
  }
  char magic[sizeof PageTrace::kMagic - 1];
  PageRequests trace;
  file.read(magic, sizeof magic);
  file.read(reinterpret_cast<char*>(&trace.page_count), sizeof trace.page_count);
  file.read(reinterpret_cast<char*>(&trace.frame_count), sizeof trace.frame_count);
  if (!file || std::memcmp(magic, PageTrace::kMagic, sizeof magic) != 0) {
    return {ErrorCode::corrupt, path + ": is no page trace"};
  }
  std::vector<std::uint32_t> words(kBufferWords);
  while (file) {
    file.read(reinterpret_cast<char*>(words.data()), static_cast<std::streamsize>(kBufferWords * sizeof words[0]));
    const auto count = static_cast<std::size_t>(file.gcount()) / sizeof words[0];
    for (const std::uint32_t word : std::span(words).first(count)) {
      const auto event = static_cast<PageTrace::Event>(word >> PageTrace::kKindShift);
      const std::uint32_t page = word & ((1U << PageTrace::kKindShift) - 1);
      if (page >= trace.page_count) {
        return {ErrorCode::corrupt,
                path + ": names page " + std::to_string(page) + " of " + std::to_string(trace.page_count)};
      }
      trace.batches += event == PageTrace::Event::batch ? 1 : 0;
      trace.reads += event == PageTrace::Event::read ? 1 : 0;
      trace.evictions += event == PageTrace::Event::evict ? 1 : 0;
      if (event == PageTrace::Event::batch || event == PageTrace::Event::enter) {
        trace.pages.push_back(page);
      }
    }
  }
  return trace;
}

}  // namespace raymill::bench
