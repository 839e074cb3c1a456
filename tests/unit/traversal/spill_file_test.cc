#include "traversal/spill_file.h"

#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace raymill::traversal {
namespace {

class SpillFileTest : public testing::Test {
 protected:
  SpillFile::Config config(std::uint32_t remembered_places) const {
    return {folder_.path(), "things", 1024, remembered_places, false};
  }
  tests::TempFolder folder_;
};

TEST_F(SpillFileTest, FreedPlacesAreTakenAgainTheFirstFirst) {
  SpillFile file(config(200));
  for (std::uint32_t i = 0; i < 150; ++i) {
    EXPECT_EQ(file.take(), i);
  }
  for (const std::uint32_t place : {140, 3, 64, 65}) {
    file.give(place);
  }
  for (const std::uint32_t place : {3, 64, 65, 140, 150}) {
    EXPECT_EQ(file.take(), place);
  }
  EXPECT_EQ(file.file_bytes(), 151u * 1024);
}

TEST_F(SpillFileTest, PlacesBeyondThoseRememberedAreNotTakenTwice) {
  SpillFile file(config(64));
  std::vector<std::byte> block(1024, std::byte{7});
  for (std::uint32_t i = 0; i < 100; ++i) {
    ASSERT_TRUE(file.write(file.take(), block).ok());
  }
  for (std::uint32_t i = 0; i < 100; ++i) {
    file.give(i);
  }
  std::set<std::uint32_t> again;
  for (std::uint32_t i = 0; i < 100; ++i) {
    EXPECT_TRUE(again.insert(file.take()).second);
  }
  EXPECT_EQ(*again.rbegin(), 135u) << "64 again, 36 new";
}

TEST_F(SpillFileTest, NoTwoHoldersOfAPlaceWhateverTheOrder) {
  SpillFile file(config(1000));
  tests::Random random(5);
  std::vector<std::uint32_t> held;
  std::set<std::uint32_t> all;
  for (int step = 0; step < 20000; ++step) {
    if (held.empty() || random.below(2) == 0) {
      held.push_back(file.take());
      ASSERT_TRUE(all.insert(held.back()).second);
    } else {
      std::swap(held[random.below(static_cast<std::uint32_t>(held.size()))], held.back());
      file.give(held.back());
      all.erase(held.back());
      held.pop_back();
    }
    ASSERT_LT(file.file_bytes() / 1024, 1000u);
  }
}

}  // namespace
}  // namespace raymill::traversal
