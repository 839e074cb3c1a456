#include "tests/bench/out_of_core/belady.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <map>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"
#include "traversal/page_trace.h"

namespace raymill::bench {
namespace {

// The least reads by trying every victim at every miss.
class BruteForce {
 public:
  BruteForce(std::vector<std::uint32_t> requests, std::size_t frames)
      : requests_(std::move(requests)), frames_(frames) {}

  std::uint64_t reads(std::size_t at = 0, std::uint32_t resident = 0) {
    if (at == requests_.size()) {
      return 0;
    }
    const auto known = known_.find({at, resident});
    if (known != known_.end()) {
      return known->second;
    }
    const std::uint32_t bit = 1U << requests_[at];
    std::uint64_t least = ~std::uint64_t(0);
    if ((resident & bit) != 0) {
      least = reads(at + 1, resident);
    } else if (static_cast<std::size_t>(std::popcount(resident)) < frames_) {
      least = 1 + reads(at + 1, resident | bit);
    } else {
      for (std::uint32_t rest = resident; rest != 0; rest &= rest - 1) {
        least = std::min(least, 1 + reads(at + 1, (resident & ~(rest & (0 - rest))) | bit));
      }
    }
    return known_[{at, resident}] = least;
  }

 private:
  const std::vector<std::uint32_t> requests_;
  const std::size_t frames_;
  std::map<std::pair<std::size_t, std::uint32_t>, std::uint64_t> known_;
};

TEST(Belady, ReadsAsFewPagesAsTheBestOfAllSchedules) {
  tests::Random random(7);
  for (int round = 0; round < 300; ++round) {
    const std::uint32_t pages = 2 + random.below(7);
    const std::uint32_t frames = 1 + random.below(pages);
    std::vector<std::uint32_t> requests(random.below(40));
    for (std::uint32_t& page : requests) {
      page = random.below(pages);
    }
    EXPECT_EQ(belady_reads(requests, pages, frames), BruteForce(requests, frames).reads()) << "round " << round;
  }
}

TEST(Belady, LongSequencesThrowOutWhatIsPastAndStayExact) {
  // A cycle of one page more than there are frames: of each frames steps but the first lap, one misses.
  constexpr std::uint32_t kFrames = 10, kLaps = 1000;
  std::vector<std::uint32_t> requests;
  for (std::uint32_t i = 0; i < kLaps * (kFrames + 1); ++i) {
    requests.push_back(i % (kFrames + 1));
  }
  const std::uint64_t reads = belady_reads(requests, kFrames + 1, kFrames);
  EXPECT_EQ(reads, kFrames + 1 + (requests.size() - kFrames - 2) / kFrames);
  EXPECT_EQ(distinct_pages(requests, kFrames + 1), kFrames + 1);
}

TEST(Belady, EnoughFramesReadEachPageOnce) {
  EXPECT_EQ(belady_reads(std::vector<std::uint32_t>{3, 1, 3, 2, 1, 3}, 4, 3), 3U);
  EXPECT_EQ(belady_reads({}, 4, 3), 0U);
}

TEST(PageTrace, IsReadAsItWasWritten) {
  const tests::TempFolder folder;
  const std::string path = folder / "run.pages";
  {
    const auto trace = *PageTrace::create(path);
    ASSERT_TRUE(trace->begin(5, 3).ok());
    EXPECT_FALSE(trace->begin(5, 3).ok()) << "a trace is of one store";
    trace->add(PageTrace::Event::read, 4);
    std::vector<std::atomic<std::uint8_t>> touched(5);
    PageTrace::Lane lane(trace, 5);
    lane.marks()[4] = lane.marks()[1] = 1;
    lane.end_batch(4, touched.data());
    EXPECT_EQ(touched[1], 1);
    lane.end_batch(2, touched.data());
    trace->add(PageTrace::Event::evict, 4);
    ASSERT_TRUE(trace->finish().ok());
  }
  const auto read = read_page_trace(path);
  ASSERT_TRUE(read) << read.status().message();
  EXPECT_EQ(read->page_count, 5U);
  EXPECT_EQ(read->frame_count, 3U);
  EXPECT_EQ(read->pages, (std::vector<std::uint32_t>{4, 1, 2}));
  EXPECT_EQ(read->batches, 2U);
  EXPECT_EQ(read->reads, 1U);
  EXPECT_EQ(read->evictions, 1U);
}

TEST(PageTrace, OtherFilesAreRefused) {
  const tests::TempFolder folder;
  EXPECT_EQ(read_page_trace(folder / "none").status().code(), ErrorCode::not_found);
  tests::write_file(folder / "text", "RMPGTRC1 is what it begins with");
  EXPECT_EQ(read_page_trace(folder / "text").status().code(), ErrorCode::corrupt);
}

}  // namespace
}  // namespace raymill::bench
